"""A bag written while messages arrive: it can be read after a kill, a full disk or a power failure.

Messages are collected in chunks. `save` ends the chunk and hands it to the operating system, so that it outlives this
process. A second thread then asks for it to be written to the disk (fdatasync), so that it also outlives the computer;
a slow disk does not delay the recording.
"""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any, NoReturn

from mcap.writer import CompressionType, Writer

from joint_id_core.errors import JointIdError

FOREVER = {"sec": 2147483647, "nsec": 4294967295}  # as rclcpp writes an infinite duration


class LiveBag:
    """A new bag of version 9, the version of ROS 2 Jazzy, with mcap storage.

    Attributes:
        saved: number of messages that the operating system has.

    Raises:
        JointIdError: the bag cannot be created, or, from every method, its disk is full or fails. Then the bag is left
            as it is, without an index: readers recover the complete chunks.
    """

    def __init__(self, path: Path) -> None:
        self.saved = 0
        self._path, self._data = path, path / f"{path.name}.mcap"
        try:
            path.mkdir()
            self._file = self._data.open("xb")
        except OSError as error:
            raise JointIdError(f"{path}: the bag cannot be created: {error}") from None
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._topics: dict[int, dict[str, Any]] = {}  # their descriptions for metadata.yaml, by channel
        self._counts: dict[int, int] = {}
        self._times: tuple[int, int] | None = None  # of the first and the last message, ns
        self._sync: threading.Thread | None = None
        self._sync_error: OSError | None = None
        try:
            self._writer.start(profile="ros2")
            self._file.flush()  # from here on the file can be recognised
        except OSError as error:
            self._abandon(error)

    def add_topic(self, name: str, type_name: str, definition: str, digest: str, reliable: bool, latched: bool) -> int:
        """Add a topic with its message definition, its type hash and the QoS it is offered with; return its number."""
        qos = [
            {
                "history": "keep_last" if latched else "unknown",
                "depth": 1 if latched else 0,
                "reliability": "reliable" if reliable else "best_effort",
                "durability": "transient_local" if latched else "volatile",
                "deadline": FOREVER,
                "lifespan": FOREVER,
                "liveliness": "automatic",
                "liveliness_lease_duration": FOREVER,
                "avoid_ros_namespace_conventions": False,
            }
        ]
        schema = self._writer.register_schema(type_name, "ros2msg", definition.encode())
        topic = self._writer.register_channel(name, "cdr", schema, {"offered_qos_profiles": json.dumps(qos)})
        self._topics[topic] = {
            "name": name,
            "type": type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": qos,
            "type_description_hash": digest,
        }
        self._counts[topic] = 0
        return topic

    def write(self, topic: int, time_ns: int, data: bytes) -> None:
        """Add a message; `time_ns` is the instant at which it was received."""
        try:
            self._writer.add_message(topic, time_ns, data, time_ns)
        except OSError as error:
            self._abandon(error)
        self._counts[topic] += 1
        first, last = self._times or (time_ns, time_ns)
        self._times = min(first, time_ns), max(last, time_ns)

    def save(self) -> None:
        """Make what was written survive this process at once, and the computer soon."""
        count = sum(self._counts.values())
        if self._sync_error is not None:
            self._abandon(self._sync_error)
        if count == self.saved:
            return
        try:
            self._writer.flush()
        except OSError as error:
            self._abandon(error)
        self.saved = count
        if self._sync is None or not self._sync.is_alive():
            self._sync = threading.Thread(target=self._to_disk)
            self._sync.start()

    def _to_disk(self) -> None:
        try:
            os.fdatasync(self._file.fileno())
        except OSError as error:
            self._sync_error = error  # told by the next call of `save`

    def close(self) -> None:
        """Write the index and metadata.yaml; nothing if the bag was given up."""
        if self._file.closed:
            return
        self.save()
        self._join()
        try:
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            partial = self._path / "metadata.yaml.part"
            partial.write_text(json.dumps(self._metadata(), indent=1), encoding="utf-8")  # JSON is YAML
            partial.replace(self._path / "metadata.yaml")
        except OSError as error:
            self._abandon(error)

    def _metadata(self) -> dict[str, Any]:
        first, last = self._times or (0, 0)
        count = sum(self._counts.values())
        span = {"duration": {"nanoseconds": last - first}, "starting_time": {"nanoseconds_since_epoch": first}}
        rows = [{"topic_metadata": row, "message_count": self._counts[topic]} for topic, row in self._topics.items()]
        return {
            "rosbag2_bagfile_information": {
                "version": 9,
                "storage_identifier": "mcap",
                "relative_file_paths": [self._data.name],
                **span,
                "message_count": count,
                "topics_with_message_count": rows,
                "compression_format": "",
                "compression_mode": "",
                "files": [{"path": self._data.name, **span, "message_count": count}],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }

    def _join(self) -> None:
        if self._sync is not None:
            self._sync.join()

    def _abandon(self, error: OSError) -> NoReturn:
        """Give the file up as it is; the buffer that could not be written is dropped."""
        self._join()
        self._file.raw.close()
        raise JointIdError(
            f"{self._path}: recording ended ({error.strerror}): the bag is not closed, but {self.saved:,} messages "
            "of it can be read. Free space or take another disk, then record again"
        ) from None
