"""Node `sim`: a simulated joint with the sensors of a UR robot, in real time; it also publishes the true parameters.

The parameters of the joint can change while it moves, by setting the ROS parameter `set`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import JointState

from joint_id_core.assignments import numbers_by_name
from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError
from joint_id_core.models import Electromechanical
from joint_id_core.simulation.plants import PLANTS, MotionOptions
from joint_id_core.simulation.sensors import UR_CHANNELS, ur_robot_sensors
from joint_id_msgs.msg import JointParams, MotorVoltages
from joint_id_ros import conversions as convert
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.options.sim import SimOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.qos import FLUSH, LATEST, STREAM_OUT

TICK_S = 0.004  # the node wakes up once for two samples at 500 Hz: a wake-up costs more than the simulation
TRIAL_S = 0.02  # of motion, with which changed parameters are tried before they are taken
CATCH_UP = 50  # most samples at once after a pause, so that signals are served in between


class SimNode(Node):
    """Advances the simulated joint with the node's clock and publishes its sensor readings."""

    def __init__(self) -> None:
        super().__init__("sim")
        self.finished, self.streams = Future(), None
        declare(self, SimOptions, read_only=False, only=("set",))
        declare(self, SimOptions, defaults={"publish_all_states": self._model_is_electromechanical()})
        declare(self, MotionOptions)
        self._options = read(self, SimOptions)
        values = _values(self._options.set)
        self._plant = PLANTS[self._options.model](values, read(self, MotionOptions), self._options.seed)
        self.add_on_set_parameters_callback(self._check)
        self.add_post_set_parameters_callback(self._change)
        self._rng = np.random.default_rng(self._options.seed)
        self._sensors = ur_robot_sensors(self._plant.values["N"])
        # The robot sends no link velocity. We chose the noise of the motor velocity, divided by the gear ratio.
        velocity = self._sensors.noise["motor_velocity"] / self._plant.values["N"]
        self._sensors = replace(self._sensors, noise={**self._sensors.noise, "link_velocity": velocity})
        self._links = self.create_publisher(JointState, "link_states", STREAM_OUT)
        self._motors = self.create_publisher(JointState, "motor_states", STREAM_OUT)
        inputs = self._plant.model.input_names
        self._voltages = (
            self.create_publisher(MotorVoltages, "motor_voltages", STREAM_OUT) if "voltage" in inputs else None
        )
        self._streams = [p for p in (self._links, self._motors, self._voltages) if p is not None]
        self._truth = self.create_publisher(JointParams, "truth", LATEST)
        self._begin_ns: int | None = None
        self._count = 0
        self._behind_s = 0.0
        self._diagnostics = Diagnostics(self, self._health)
        self.create_timer(max(1.0 / self._options.rate, TICK_S), self._tick)

    def _model_is_electromechanical(self) -> bool:
        declare(self, SimOptions, only=("model",))
        return self.get_parameter("model").value == Electromechanical.name

    def _tick(self) -> None:
        """Publish every sample that is due; stamps are computed from the sample count alone and cannot drift."""
        now = self.get_clock().now().nanoseconds
        if self._begin_ns is None:
            # With use_sim_time the clock is zero until the first message on /clock.
            if now == 0 or min(p.get_subscription_count() for p in self._streams) < self._options.wait_subscribers:
                return
            self._begin_ns = now
            self._publish_truth()
        for _ in range(CATCH_UP):
            instant_ns = self._next_ns(self._begin_ns)
            self._behind_s = (now - instant_ns) / NANO
            if instant_ns > now:
                return
            if 0.0 < self._options.duration <= self._count / self._options.rate:
                self.finished.set_result(None)
                return
            try:
                row = self._plant.tick(1.0 / self._options.rate)
            except JointIdError as error:
                self.finished.set_result(error)
                return
            self._publish(instant_ns, row)
            self._count += 1

    def _next_ns(self, begin_ns: int) -> int:
        """Return the stamp of the next sample of a motion that began at `begin_ns`."""
        return begin_ns + round(self._count * NANO / self._options.rate)

    def _check(self, changes: Sequence[Parameter]) -> SetParametersResult:
        """Refuse values that the joint cannot have, or with which it cannot be simulated on from where it is."""
        for p in changes:
            if p.name == "set":
                try:
                    trial = deepcopy(self._plant)
                    trial.change(_values(p.value))
                    trial.tick(TRIAL_S)
                except JointIdError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _change(self, changes: Sequence[Parameter]) -> None:
        """Let the joint go on with the values that were set, and publish them with the instant from which they hold."""
        for p in changes:
            if p.name == "set":
                before = self._plant.values
                self._plant.change(_values(p.value))
                if self._begin_ns is not None and self._plant.values != before:
                    self._publish_truth()

    def _publish(self, instant_ns: int, row: dict[str, float]) -> None:
        """Publish the sensor readings of the true values."""
        shown = row
        if self._options.noise:
            shown = {name: float(self._sensors.reading(name, value, self._rng)) for name, value in row.items()}
        if not self._options.publish_all_states:
            shown = {name: value for name, value in shown.items() if name in (*UR_CHANNELS, "voltage")}

        def values(channel: str) -> list[float]:
            return [shown[channel]] if channel in shown else []

        stamp, name = convert.to_stamp(instant_ns), [self._options.joint]
        links = JointState(
            name=name, position=values("link_position"), velocity=values("link_velocity"), effort=values("current")
        )
        motors = JointState(name=name, position=values("motor_position"), velocity=values("motor_velocity"))
        links.header.stamp = motors.header.stamp = stamp
        self._links.publish(links)
        self._motors.publish(motors)
        if self._voltages is not None:
            voltages = MotorVoltages(name=name, voltage=values("voltage"))
            voltages.header.stamp = stamp
            self._voltages.publish(voltages)
        self._diagnostics.received(instant_ns)

    def _publish_truth(self) -> None:
        assert self._begin_ns is not None
        since_ns = self._next_ns(self._begin_ns)
        message = convert.to_truth_message(self._options.joint, self._plant.model, self._plant.values, since_ns)
        params = JointParams(joints=[message])
        params.header.stamp = convert.to_stamp(since_ns)
        self._truth.publish(params)

    def _health(self) -> Health:
        state = "moving" if self._begin_ns is not None else "waiting for subscribers or for the clock"
        return Health(message=state, values={"published": self._count, "behind [s]": f"{self._behind_s:.4f}"})

    def close(self) -> None:
        """Wait until the last samples have arrived."""
        for publisher in self._streams:
            publisher.wait_for_all_acked(FLUSH)


def _values(texts: Sequence[str]) -> dict[str, float]:
    """Return the values in the ROS parameter `set`; for ROS an empty list is a list with one empty string."""
    return numbers_by_name(filter(None, texts), "parameter set")
