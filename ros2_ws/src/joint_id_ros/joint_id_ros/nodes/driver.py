"""Node `driver`: publishes the measurements of a UR robot. It only reads: nothing here can move a robot."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.client import Client, Request, Sample
from joint_id_core.rtde.clients import CLIENTS
from joint_id_core.rtde.connection_check import ConnectionCheck
from joint_id_core.rtde.errors import RefusedError, RobotError
from joint_id_core.rtde.gate import Gate
from joint_id_core.rtde.stamping import WAITS, Stamper
from joint_id_core.rtde.stream import RobotStream, StreamOptions
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.options.driver import DriverOptions
from joint_id_ros.parameters import read
from joint_id_ros.qos import STREAM_OUT
from joint_id_ros.robot_health import RobotHealth
from joint_id_ros.robot_signals import TYPES, JointMessages

NEWS = ("connected", "message", "mode")  # events that are not problems
POLL_S = 0.1  # period of the checks, at a start without a lifecycle manager, whether the robot has answered


class DriverNode(ManagedNode):
    """Publishes every valid sample of a robot, from the thread that reads them from the network."""

    def __init__(self, **how: Any) -> None:
        super().__init__("driver", DriverOptions, StreamOptions, **how)
        self._options, self._stream_options = DriverOptions(), StreamOptions()
        self._messages = JointMessages(self._options)
        self._outputs: dict[str, Any] = {}  # publishers by topic
        self._check: ConnectionCheck | None = None
        self._stream: RobotStream | None = None
        self._may_pass = False  # whether the error that prevents the configuration may disappear by itself
        self._wait_s = self._next_try = 0.0
        self._renew()
        self._diagnostics = Diagnostics(self, self._report)
        self._starter = self.create_timer(POLL_S, self._start_by_itself, clock=Clock(clock_type=ClockType.STEADY_TIME))
        if not self.get_parameter("autostart").value:
            self._starter.cancel()

    def _renew(self) -> None:
        """Forget the previous run."""
        self._gate, self._stamper = Gate(), Stamper(self._on_event)
        self._health = RobotHealth(self._options.joints, self._options.rate, self._on_event)

    def _client(self) -> Client:
        """Build a client for one connection to the robot."""
        o = self._options
        return CLIENTS[o.client](Request(o.robot_ip.strip(), self._messages.fields, o.rate, o.port, o.timeout))

    def _ask(self) -> ConnectionCheck:
        """Check whether the robot offers what the parameters request; return a running check if there is one."""
        if self.get_parameter("use_sim_time").value:
            raise JointIdError("parameter use_sim_time is true, but a robot runs in real time: set it to false")
        options = read(self, DriverOptions)
        if not options.robot_ip.strip():
            raise JointIdError("parameter robot_ip is missing: give the name or the address of the robot")
        if self._check is None or options != self._options:
            self._give_up()
            self._options, self._messages = options, JointMessages(options)
            self._check = ConnectionCheck(self._client())
        return self._check

    def _give_up(self) -> None:
        if self._check is not None:
            self._check.cancel()
            self._check = None

    def prepare(self) -> None:
        """Check the parameters; those that depend on the robot are checked with the robot, whose answer is awaited."""
        self._may_pass = False
        self._stream_options = read(self, StreamOptions)
        check = self._ask()
        try:
            version = check.version()
        except RobotError as error:
            self._may_pass = not isinstance(error, RefusedError)
            raise
        finally:
            self._check = None
        for topic in set(self._messages.topics) - self._outputs.keys():
            self._outputs[topic] = self.create_lifecycle_publisher(TYPES[topic], topic, STREAM_OUT)
        self.get_logger().info(f"controller {'.'.join(map(str, version))} offers {', '.join(self._messages.fields)}")

    def remedy(self, error: JointIdError) -> str:
        """Return advice that says whether the node tries again by itself."""
        if not self._may_pass:
            return super().remedy(error)
        return "configure again when it is there" if self._starter.is_canceled() else "trying again until it is there"

    def _start_by_itself(self) -> None:
        """Configure and activate as soon as the robot answers; waiting for it in a callback would delay signals."""
        if self._state_machine.current_state[1] != "unconfigured":
            self._starter.cancel()  # a lifecycle manager did it
            return
        if time.monotonic() < self._next_try:
            return
        try:
            if not self._ask().done:
                return
        except JointIdError:
            pass  # `start` gets the same error and reports it
        if self.start() or not self._may_pass:
            self._starter.cancel()
        self._wait_s = min(max(2.0 * self._wait_s, self._stream_options.backoff_s), self._stream_options.backoff_max_s)
        self._next_try = time.monotonic() + self._wait_s

    def begin(self) -> None:
        """Start the stream."""
        self._renew()
        rate = self._options.rate
        self._stream = RobotStream(self._client, rate, self._stream_options, self._on_samples, self._on_event)
        self._stream.start()

    def close(self) -> None:
        """End the stream; nothing is published afterwards."""
        self._give_up()
        if self._stream is not None:
            self._stream.stop()
            self._stream = None

    def _on_samples(self, samples: list[Sample]) -> None:
        """Publish samples; called from the stream's thread."""
        for sample in samples:
            reason = self._gate.admit(sample.values)
            stamp_ns = None if reason else self._stamper.stamp(sample, samples[-1])
            self._health.note(sample.values, reason or ("" if stamp_ns is not None else WAITS))
            if stamp_ns is None:
                continue
            for topic, message in self._messages.write(stamp_ns, sample.values).items():
                self._outputs[topic].publish(message)
            self._diagnostics.received(stamp_ns)

    def _on_event(self, kind: str, text: str) -> None:
        """Report an event; called from the stream's thread."""
        if kind == "connected":
            self._stamper.new_connection()
        if kind in NEWS:
            self.get_logger().info(text)
        else:
            self._diagnostics.problem(kind, text)

    def _report(self) -> Health:
        stream = self._stream
        if self.not_ready or stream is None:
            return Health(DiagnosticStatus.ERROR, self.not_ready or "stopped")
        return self._health.report(stream.status)
