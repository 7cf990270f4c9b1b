"""Convert samples to messages: which field or register becomes which signal of the joints."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from operator import itemgetter, mul
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState

from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError
from joint_id_core.formats.cdr import HEADER
from joint_id_core.rtde.fields import FIELDS, JOINTS, register_type
from joint_id_core.rtde.packets import Value
from joint_id_msgs.msg import RobotSignals
from joint_id_ros.options.driver import DriverOptions
from joint_id_ros.raw_messages import layout_of

STATUS_FIELDS = ("timestamp", "robot_mode", "safety_mode", "joint_mode")  # always read
TYPES: dict[str, Any] = {"link_states": JointState, "motor_states": JointState, "robot_signals": RobotSignals}
SLOW = {"joint_temperatures"}
SLOW_NS = NANO // 2  # time between messages that hold nothing but slow signals
_STAMP, _SIX = struct.Struct("=iI"), struct.Struct(f"={JOINTS}d")  # in the order of bytes of this computer, as rclpy
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


class _Signal(NamedTuple):
    """A field of a topic's message, with the function that gets its values from a sample, and their factors if any."""

    topic: str
    field: str
    values: Any
    factors: tuple[float, ...]


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
    """The messages of one sample, as bytes.

    Stamp and values are written at their places in the bytes of the last sample's messages. Building message objects,
    filling and serializing them would cost several times as much.
    """

    def __init__(self, options: DriverOptions) -> None:
        """Choose the fields to read.

        Raises:
            JointIdError: a source that does not exist, a source that is used twice, or no source at all.
        """
        ratios = options.gear_ratio * (JOINTS if len(options.gear_ratio) == 1 else 1)
        used: dict[str, str] = {}
        signals: list[_Signal] = []
        for source in SOURCES:
            fields = source_fields(source, getattr(options, source.parameter))
            for name in fields:
                if name in used:
                    raise JointIdError(f"{name} is read for both {used[name]} and {source.parameter}: change one")
                used[name] = source.parameter
            if fields:
                geared = source.geared and len(fields) == 1
                signals.append(_Signal(source.topic, source.field, itemgetter(*fields), ratios if geared else ()))
        if not used:
            names = ", ".join(source.parameter for source in SOURCES)
            raise JointIdError(f"there is nothing to publish: give at least one of {names}")
        for name in dict.fromkeys(options.extra_fields):
            signals.append(_Signal("robot_signals", name, itemgetter(name), ()))
        self.fields = tuple(dict.fromkeys((*STATUS_FIELDS, *used, *options.extra_fields)))
        self.topics = tuple(dict.fromkeys(signal.topic for signal in signals))
        self._fast = tuple(t for t in self.topics if t != "robot_signals" or set(options.extra_fields) - SLOW)
        self._last_slow_ns = -SLOW_NS
        self._messages: dict[str, bytearray] = {}
        self._places: dict[str, list[tuple[int, _Signal]]] = {}
        for topic in self.topics:
            self._lay_out(topic, options.joints, [signal for signal in signals if signal.topic == topic])

    def _lay_out(self, topic: str, joints: tuple[str, ...], signals: list[_Signal]) -> None:
        """Prepare the bytes of a topic's message, and find the places of the signals there."""
        message = TYPES[topic](name=list(joints))
        for signal in signals:
            setattr(message, signal.field, [0.0] * JOINTS)
        layout = layout_of(message)
        self._messages[topic] = bytearray(layout.template)
        self._places[topic] = [(layout.offset(signal.field), signal) for signal in signals]

    def write(self, stamp_ns: int, values: Mapping[str, Value]) -> dict[str, bytes]:
        """Return the messages to publish with one sample, by topic."""
        sec, nanosec = divmod(stamp_ns, NANO)
        messages: dict[str, bytes] = {}
        for topic in self._due(stamp_ns):
            data = self._messages[topic]
            _STAMP.pack_into(data, HEADER, sec, nanosec)
            for offset, signal in self._places[topic]:
                measured = signal.values(values)
                _SIX.pack_into(data, offset, *(map(mul, measured, signal.factors) if signal.factors else measured))
            messages[topic] = bytes(data)
        return messages

    def _due(self, stamp_ns: int) -> tuple[str, ...]:
        """Return the topics of the messages to publish with this sample: all of them, or those that are not slow."""
        if abs(stamp_ns - self._last_slow_ns) < SLOW_NS:
            return self._fast
        self._last_slow_ns = stamp_ns
        return self.topics
