"""Health of a node on /diagnostics, once per second."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from joint_id_ros.parameters import unknown

PERIOD_S = 1.0
FOREIGN_S = 3600.0  # stamps with a larger difference to the node's clock come from another clock
PAUSE_S = 3.0  # time between two reports from which the process did not run as it should
LOG_EVERY_S = 5.0  # shortest time between two log lines on the same kind of problem


@dataclass
class Health:
    """A node's report on itself: the worst level, a sentence, and values by name."""

    level: bytes = DiagnosticStatus.OK
    message: str = "ok"
    values: dict[str, object] = field(default_factory=dict)


class Diagnostics:
    """Counts messages and problems, logs problems at a limited rate, and publishes diagnostics at 1 Hz.

    The timer runs on the steady clock: with `use_sim_time` the reports must go on even if /clock stops. Stamps come
    from the node's clock.
    """

    def __init__(self, node: Node, health: Callable[[], Health] = Health, source: str = "") -> None:
        """Start the reports; `health` returns the node's own part, `source` is the topic that must deliver, if any."""
        self._node, self._health, self._source = node, health, source
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(PERIOD_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._since = time.monotonic()
        self._received = self._before = 0
        self._started = False
        self._newest_ns: int | None = None
        self._problems: Counter[str] = Counter()
        self._recent: dict[str, str] = {}  # newest problem of each kind since the last report
        self._logged: dict[str, float] = {}
        self._unknown = unknown(node)
        for text in self._unknown:
            node.get_logger().warning(text)

    def received(self, stamp_ns: int) -> None:
        """Count a message with this stamp."""
        self.started()
        self._received += 1
        self._newest_ns = stamp_ns

    def started(self) -> None:
        """Take the start of the node for over, so that a stop soon after it is told."""
        if not self._started:
            self._since, self._started = time.monotonic(), True

    def problem(self, kind: str, text: str, count: int = 1) -> None:
        """Report a problem with the data: it is counted by kind, and appears in the next report and in the log."""
        self._problems[kind] += count
        self._recent[kind] = text
        now = time.monotonic()
        if now - self._logged.get(kind, -LOG_EVERY_S) >= LOG_EVERY_S:
            self._logged[kind] = now
            self._node.get_logger().warning(text)

    @property
    def problems(self) -> Mapping[str, int]:
        """Number of problems by kind since the start."""
        return self._problems

    def report_if_due(self) -> None:
        """Report from within a callback that takes long, in which the timer cannot."""
        if time.monotonic() - self._since >= PERIOD_S:
            self._publish()

    def _publish(self) -> None:
        now = time.monotonic()
        if self._started and now - self._since > PAUSE_S:  # before, the node starts
            text = f"this node did not run for {now - self._since:.1f} s: it was stopped, or the computer is overloaded"
            self.problem("paused", text)
        health = self._health()
        rate = (self._received - self._before) / (now - self._since)
        self._since, self._before, self._started = now, self._received, True
        clock = self._node.get_clock().now()
        values: dict[str, object] = {"received": self._received, "rate [Hz]": f"{rate:.1f}"}
        if self._newest_ns is not None:
            lag = (clock.nanoseconds - self._newest_ns) * 1e-9
            values["lag [s]"] = f"{lag:.4f}" if abs(lag) < FOREIGN_S else "stamps of another clock: see use_sim_time"
        values |= {f"problems: {kind}": n for kind, n in sorted(self._problems.items())}
        values |= health.values
        level, message = health.level, health.message
        if self._recent:
            recent, self._recent = self._recent, {}
            values["last problem"] = "; ".join(recent.values())
            message = "; ".join([*recent.values(), *([message] if level > DiagnosticStatus.OK else [])])
            level = max(level, DiagnosticStatus.WARN)
        elif self._source and rate == 0.0 and level == DiagnosticStatus.OK:
            level, message = DiagnosticStatus.WARN, f"nothing received on {self._source} in the last second"
        if self._unknown:
            level, message = max(level, DiagnosticStatus.WARN), "; ".join((*self._unknown, message))
        status = DiagnosticStatus(level=level, name=self._node.get_fully_qualified_name(), message=message)
        status.hardware_id = self._node.get_namespace().strip("/") or "joint_id"  # a robot has a namespace of its own
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = clock.to_msg()
        self._publisher.publish(array)
