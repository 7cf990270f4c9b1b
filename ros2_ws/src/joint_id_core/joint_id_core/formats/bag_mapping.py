"""Fields of bag topics as channels: mappings of the user, such as `current=joint_states.effort`, and joint states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rosbags.interfaces import Connection

from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.formats.mapping import TIME, parse
from joint_id_core.formats.remote import Place
from joint_id_core.formats.topics import JOINT_STATE, RAW, SIGNAL_FIELDS, SIGNALS, Topic

# Of a topic of joint states that is the only one. The message is defined with efforts in Nm.
STATES = {"position": "link_position", "velocity": "link_velocity", "effort": "torque"}
OF_UR = ("shoulder_pan_joint", "wrist_3_joint")  # whose effort may be a current, by version of the driver
FIELDS = {topic.type: tuple(topic.fields) for topic in RAW}
FIELDS |= {JOINT_STATE: ("position", "velocity", "effort"), SIGNALS.type: SIGNAL_FIELDS}


class Source(NamedTuple):
    """A topic to read, and the factor of each of its channels (1 if it has no entry)."""

    topic: Topic
    connection: Connection
    factors: Mapping[str, float]


def columns(connections: Sequence[Connection]) -> list[str]:
    """Return the fields that a mapping can name: "topic.field" without a leading slash."""
    return [f"{c.topic.strip('/')}.{field}" for c in connections for field in FIELDS.get(c.msgtype, ())]


def plan(path: Place, connections: Sequence[Connection], mapping: Mapping[str, str]) -> list[Source]:
    """Return the topics to read for a mapping {channel: expression}; an expression is one field times numbers.

    Raises:
        JointIdError: an unknown channel or field, an expression of another form, a field that is used twice.
    """
    found = columns(connections)
    channels: dict[str, tuple[str, float]] = {}  # by column: channel, factor
    for channel, expression in mapping.items():
        if channel == TIME:
            raise JointIdError(f"{path}: {TIME} of a bag is always header.stamp: leave {TIME}={expression} out")
        if channel not in CHANNELS:
            raise JointIdError(
                f"{path}: cannot map to {channel!r}{close_to(channel, CHANNELS)}: known are {', '.join(CHANNELS)}"
            )
        product = parse(path, channel, "*".join(p.strip().lstrip("/") for p in expression.split("*")), found)
        if len(product.names) != 1 or product.names[0] in channels:
            raise JointIdError(
                f"{path}: {channel}={expression}: take one field for each channel, times numbers, and each field once; "
                f"the fields are {', '.join(found)}"
            )
        channels[product.names[0]] = channel, product.factor
    sources = []
    for connection in connections:
        name = connection.topic.strip("/")
        used = {f: channels[f"{name}.{f}"] for f in FIELDS.get(connection.msgtype, ()) if f"{name}.{f}" in channels}
        if used:
            topic = Topic(name, connection.msgtype, {field: channel for field, (channel, _) in used.items()})
            sources.append(Source(topic, connection, dict(used.values())))
    return sources


def only_states(connections: Sequence[Connection]) -> Connection | None:
    """Return the topic of joint states of a bag, if it is the only one with messages."""
    found = [c for c in connections if c.msgtype == JOINT_STATE and c.msgcount]
    return found[0] if len(found) == 1 else None


def states(connection: Connection, names: Sequence[str]) -> Topic | None:
    """Return how joint states are read; None if nobody can know: the joints have the `names` of a UR robot."""
    if all(any(name.endswith(one) for name in names) for one in OF_UR):
        return None
    return Topic(connection.topic.strip("/"), JOINT_STATE, STATES)


def of_states(topic: Topic) -> str:
    """Return in words what is taken for what on a topic of joint states."""
    return (
        f"/{topic.name}.effort is taken as a torque in Nm, as the message is defined; if it is a current: --map "
        f"link_position={topic.name}.position --map current={topic.name}.effort"
    )


def example(connections: Sequence[Connection]) -> str:
    """Return advice on how to map the fields of an unknown topic; "" if no topic can be mapped."""
    topic = next((c.topic.strip("/") for c in connections if c.msgtype == JOINT_STATE), None)
    if topic is None:
        return ""
    return (
        f"; name the fields of others, e.g. --map link_position={topic}.position --map current={topic}.effort, or "
        f"torque={topic}.effort if it is in Nm"
    )
