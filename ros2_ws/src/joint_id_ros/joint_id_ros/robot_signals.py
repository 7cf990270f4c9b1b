"""Convert samples to messages: which field or register becomes which signal of the joints."""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping
from operator import itemgetter, mul
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState

from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import FIELDS, JOINTS, register_type
from joint_id_core.rtde.packets import Value
from joint_id_msgs.msg import RobotSignals
from joint_id_ros.options.driver import DriverOptions

STATUS_FIELDS = ("timestamp", "robot_mode", "safety_mode", "joint_mode")  # always read
TYPES: dict[str, Any] = {"link_states": JointState, "motor_states": JointState, "robot_signals": RobotSignals}
SLOW = {"joint_temperatures"}
SLOW_NS = NANO // 2  # time between messages that hold nothing but slow signals
RANGE = re.compile(r"((?:input|output)_double_register_)(\d+)\.\.(\d+)")


class Source(NamedTuple):
    """A signal whose source is chosen by a parameter.

    With `geared`, a field holds the value at the joint and is multiplied by the gear ratio to get it at the motor.
    """

    parameter: str
    topic: str
    field: str
    unit: str
    geared: bool


SOURCES = (
    Source("link_position_source", "link_states", "position", "rad", False),
    Source("current_source", "link_states", "effort", "A", False),
    Source("motor_position_source", "motor_states", "position", "rad", True),
    Source("motor_velocity_source", "motor_states", "velocity", "rad/s", True),
)


def source_fields(source: Source, text: str) -> tuple[str, ...]:
    """Return the field, or the six registers, that a source names; () if the text is empty.

    Raises:
        JointIdError: neither a vector field in the unit of the signal nor six registers; the message says what is
            allowed.
    """
    vectors = [f.name for f in FIELDS.values() if f.type == "VECTOR6D" and f.unit == source.unit]
    if not text or text in vectors:
        return (text,) if text else ()
    if match := RANGE.fullmatch(text):
        names = tuple(f"{match[1]}{k}" for k in range(int(match[2]), int(match[3]) + 1))
        if len(names) == JOINTS and all(register_type(name) == "DOUBLE" for name in names):
            return names
    raise JointIdError(
        f"parameter {source.parameter} = {text!r}: give one of {', '.join(vectors)}, six registers such as "
        f'output_double_register_24..29 (there are 0 to 47), or "" for a signal that is not measured'
    )


class JointMessages:
    """The messages of one sample.

    The same message objects are used for every sample, because building new ones costs more than filling and
    publishing them.
    """

    def __init__(self, options: DriverOptions) -> None:
        """Choose the fields to read.

        Raises:
            JointIdError: a source that does not exist, a source that is used twice, or no source at all.
        """
        self.by_topic: dict[str, Any] = {}
        self._rows: list[tuple[Any, str, Any, tuple[float, ...]]] = []  # message, field, values of a sample, factors
        ratios = options.gear_ratio * (JOINTS if len(options.gear_ratio) == 1 else 1)
        used: dict[str, str] = {}
        for source in SOURCES:
            fields = source_fields(source, getattr(options, source.parameter))
            for name in fields:
                if name in used:
                    raise JointIdError(f"{name} is read for both {used[name]} and {source.parameter}: change one")
                used[name] = source.parameter
            if fields:
                geared = source.geared and len(fields) == 1
                self._add(options, source.topic, source.field, fields, ratios if geared else ())
        if not used:
            names = ", ".join(source.parameter for source in SOURCES)
            raise JointIdError(f"there is nothing to publish: give at least one of {names}")
        for name in dict.fromkeys(options.extra_fields):
            self._add(options, "robot_signals", name, (name,), ())
        self._fast = {
            t: m for t, m in self.by_topic.items() if t != "robot_signals" or set(options.extra_fields) - SLOW
        }
        self._last_slow_ns = -SLOW_NS
        self.fields = tuple(dict.fromkeys((*STATUS_FIELDS, *used, *options.extra_fields)))

    def _add(
        self, options: DriverOptions, topic: str, field: str, fields: tuple[str, ...], factors: tuple[float, ...]
    ) -> None:
        """Add a field of a topic's message to the fields that `fill` sets."""
        if topic not in self.by_topic:
            self.by_topic[topic] = TYPES[topic](name=list(options.joints))
        self._rows.append((self.by_topic[topic], field, itemgetter(*fields), factors))

    def fill(self, stamp_ns: int, values: Mapping[str, Value]) -> None:
        """Write one sample into all messages."""
        sec, nanosec = divmod(stamp_ns, NANO)
        for message in self.by_topic.values():
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        for message, field, row, factors in self._rows:
            measured = row(values)  # one field: its vector; several fields: a tuple of their values
            setattr(message, field, array("d", map(mul, measured, factors) if factors else measured))

    def due(self, stamp_ns: int) -> Mapping[str, Any]:
        """Return the messages to publish with this sample, by topic: all of them, or those that are not slow."""
        if abs(stamp_ns - self._last_slow_ns) < SLOW_NS:
            return self._fast
        self._last_slow_ns = stamp_ns
        return self.by_topic
