"""Read an mcap file that was not closed: its writer was killed, the disk was full, or it lost its end.

An mcap file is a sequence of records. Messages are records, or they are in records called chunks; an index is appended
when the file is closed (https://mcap.dev/spec). Without the index, the whole file is read once to find what is in it.
What follows the first record that is incomplete or has a wrong checksum is left out.
"""

from __future__ import annotations

import heapq
import io
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from typing import BinaryIO, NamedTuple, TypeAlias, cast

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Message, Schema
from mcap.stream_reader import get_chunk_data_stream
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.metadata import parse_qos

from joint_id_core.errors import JointIdError
from joint_id_core.formats.remote import Place

MAGIC = b"\x89MCAP0\r\n"  # the first and the last bytes of a closed file
HEAD = struct.Struct("<BQ")  # each record begins with its kind and the length of its content
FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}


def is_unclosed(path: Place) -> bool:
    """Return whether `path` is an mcap file with a beginning but no end."""
    if path.suffix.lower() != ".mcap" or path.stat().st_size <= len(MAGIC):
        return False
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        file.seek(-len(MAGIC), 2)
        return begin == MAGIC and file.read() != MAGIC


Part: TypeAlias = Schema | Channel | Message


class _Block(NamedTuple):
    """A complete chunk, or a message outside chunks: record time of its first message in ns, place in the file."""

    start_ns: int
    offset: int


class UnclosedReader:
    """Reads the complete records, with those attributes of `rosbags.rosbag2.Reader` that joint_id uses.

    Attributes:
        path: the file.
        connections: the topics, with the number of their messages.
        message_count: number of messages.
        start_time: record time of the earliest message, ns.

    Raises:
        JointIdError: the file was not written by ROS 2, or no message in it is complete.
    """

    def __init__(self, path: Place) -> None:
        self.path = path
        self._file: BinaryIO = cast(BinaryIO, path.open("rb"))
        self._blocks: list[_Block] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        try:
            self._index()
            if not self._blocks:
                raise JointIdError(
                    f"{path}: not a readable bag, damaged or truncated, no complete message is in it: record it again"
                )
            self.connections = [self._connection(channel) for channel in self._channels.values()]
        except BaseException:
            self._file.close()
            raise
        self.message_count = self._counts.total()
        self.start_time = min(block.start_ns for block in self._blocks)

    def _index(self) -> None:
        """Find the complete records, and what is in them."""
        size = self.path.stat().st_size
        for offset, opcode, body in _records(self._file, len(MAGIC), size):
            if opcode == Opcode.HEADER and (profile := Header.read(_stream(body)).profile) != "ros2":
                raise JointIdError(f"{self.path}: an mcap file with the profile {profile!r}: give one of ROS 2")
            try:
                parts = _parts(opcode, body)
            except Exception:  # decompressors and parsers raise many kinds of errors on damaged bytes
                return
            self._schemas.update({part.id: part for part in parts if isinstance(part, Schema)})
            self._channels.update({part.id: part for part in parts if isinstance(part, Channel)})
            messages = [part for part in parts if isinstance(part, Message)]
            if any(message.channel_id not in self._channels for message in messages):
                return
            if messages:
                self._blocks.append(_Block(min(message.log_time for message in messages), offset))
                self._counts.update(message.channel_id for message in messages)

    def _connection(self, channel: Channel) -> Connection:
        """Return a topic in the terms of rosbags."""
        schema = self._schemas[channel.schema_id]
        kind = FORMATS.get(schema.encoding, MessageDefinitionFormat.NONE)
        profiles = parse_qos(channel.metadata.get("offered_qos_profiles", ""))
        return Connection(
            id=channel.id,
            topic=channel.topic,
            msgtype=schema.name,
            msgdef=MessageDefinition(kind, schema.data.decode()),
            digest="",
            msgcount=self._counts[channel.id],
            ext=ConnectionExtRosbag2(channel.message_encoding, profiles),
            owner=self,
        )

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield topic, record time in ns and bytes of the messages of some topics, in order of time."""
        wanted = {connection.id: connection for connection in connections}
        waiting: list[tuple[int, int, int, bytes]] = []  # a heap of: time, order of arrival, topic, bytes
        arrived = 0
        for block in [*sorted(self._blocks), None]:
            while waiting and (block is None or waiting[0][0] < block.start_ns):  # no later block has an earlier one
                time_ns, _, topic, data = heapq.heappop(waiting)
                yield wanted[topic], time_ns, data
            if block is None:
                return
            _, opcode, body = next(_records(self._file, block.offset, self.path.stat().st_size))
            for part in _parts(opcode, body):
                if isinstance(part, Message) and part.channel_id in wanted:
                    heapq.heappush(waiting, (part.log_time, arrived, part.channel_id, part.data))
                    arrived += 1

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _records(file: BinaryIO, offset: int, size: int) -> Iterator[tuple[int, int, bytes]]:
    """Yield place, kind and content of the complete records from `offset` on, in a file of `size` bytes."""
    while offset + HEAD.size <= size:
        file.seek(offset)
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        if offset + HEAD.size + length > size:
            return
        yield offset, opcode, file.read(length)
        offset += HEAD.size + length


def _parts(opcode: int, body: bytes) -> list[Part]:
    """Return the schemas, topics and messages in a record.

    Raises:
        ValueError, and others of mcap and of the decompressors: the record is damaged.
    """
    if opcode == Opcode.SCHEMA:
        return [Schema.read(_stream(body))]
    if opcode == Opcode.CHANNEL:
        return [Channel.read(_stream(body))]
    if opcode == Opcode.MESSAGE:
        return [Message.read(_stream(body), len(body))]
    if opcode != Opcode.CHUNK:
        return []
    chunk = Chunk.read(_stream(body))
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    content = stream.read(size)
    inner = list(_records(io.BytesIO(content), 0, size))
    if size != chunk.uncompressed_size or sum(HEAD.size + len(part) for _, _, part in inner) != size:
        raise ValueError("the content of the chunk is not complete")
    return [part for _, code, data in inner if code != Opcode.CHUNK for part in _parts(code, data)]


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))
