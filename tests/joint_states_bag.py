"""A bag of `/joint_states` as the official driver of UR robots publishes it, of a robot that is known in closed form.

Shape of the messages, from ros-controls/ros2_controllers (joint_state_broadcaster, branch jazzy) and
UniversalRobots/Universal_Robots_ROS2_Driver (ur_robot_driver, branch jazzy): all joints in one message, in an order
that is not that of the chain, with the driver's tf_prefix; frame_id base_link; position `actual_q`; velocity
`actual_qd`, which is that of the motor over the ratio and exactly zero at rest; effort `actual_current`, or a torque in
newer versions. The stamp is the system's time in the control loop, so it jitters.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import ur_robot_sensors

ORDER = ("shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint", "shoulder_pan_joint")
KIND = "sensor_msgs/msg/JointState"
NANO = 10**9
RATE, DURATION = 500, 6
LEAD_S = 1.0  # the recording begins while the robot moves, not with the jerk at which the simulated controllers start
BEGIN = 1_700_000_000 * NANO
JITTER_NS = 20_000  # standard deviation of the stamps, our choice
N = 101.0


@dataclass(frozen=True)
class Moving:
    """A simulated joint: model, options, values that differ from its nominal ones."""

    model: str
    values: dict[str, float]
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def truth(self) -> dict[str, float]:
        """Values of all its parameters."""
        return build(self.model, actuation="current", **self.options).values(self.values)


ROBOT = {
    "elbow_joint": Moving("harmonic_drive", {"k_t": 0.08, "k_1": 6000.0, "J_q": 0.9}),
    "shoulder_pan_joint": Moving("harmonic_drive", {"k_t": 0.1, "k_1": 9000.0, "J_q": 1.3}),
    "shoulder_lift_joint": Moving(
        "rigid_joint",
        {"N": N, "k_t": 0.1, "J": 2.0, "c": 15.0, "tau_f": 8.0, "tau_0": 0.0, "a_g": 40.0, "b_g": 12.0},
        {"gravity": True},
    ),
}


def measured(effort: str) -> dict[str, tuple[np.ndarray, ...]]:
    """Position, velocity and effort by joint, each of shape (T,); `effort` is what the filter calls effort_source."""
    time = np.arange(round(RATE * (LEAD_S + DURATION))) / RATE
    rng = np.random.default_rng(7)
    rows: dict[str, tuple[np.ndarray, ...]] = {}
    for number, joint in enumerate(ORDER):
        if joint not in ROBOT:
            position = 0.3 * number + 2e-5 * rng.standard_normal(len(time))
            velocity = np.where(rng.random(len(time)) < 0.5, 0.0, -0.0)
            rows[joint] = position, velocity, 0.01 * rng.standard_normal(len(time))
            continue
        moving, p = ROBOT[joint], ROBOT[joint].truth
        model = build(moving.model, actuation="current", **moving.options)
        reference = position_reference(0.4, seed=number + 1)
        true = simulate_closed_loop(model, PositionController(), reference, time, moving.values)
        if "motor_velocity" not in true:
            true = true.with_channels({"motor_velocity": N * true["link_velocity"]})
        shown = ur_robot_sensors(N).measure(true, seed=number)
        value = shown["current"]
        if effort != "current":
            value = N * p["k_t"] * value
        if effort == "gravity_free_torque" and "a_g" in p:
            q = true["link_position"]
            value = value - p["a_g"] * np.cos(q) - p["b_g"] * np.sin(q)
        rows[joint] = shown["link_position"], shown["motor_velocity"] / N, value
    return {joint: tuple(values[time >= LEAD_S] for values in row) for joint, row in rows.items()}


def write(path: Path, effort: str, tf_prefix: str = "", jitter_ns: float = JITTER_NS) -> Path:
    """Record the robot's motion as an mcap bag."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    rows = measured(effort)
    names = [tf_prefix + joint for joint in rows]
    table = np.array(list(rows.values()))  # joints, fields, samples
    jitter = jitter_ns * np.random.default_rng(0).standard_normal(table.shape[2])
    with Writer(path, version=9) as writer:
        text = writer.add_connection("/robot_description", "std_msgs/msg/String", typestore=store)
        writer.write(text, BEGIN, store.serialize_cdr(types[text.msgtype]("<robot/>"), text.msgtype))
        connection = writer.add_connection("/joint_states", KIND, typestore=store)
        for k in range(table.shape[2]):
            stamp = BEGIN + k * NANO // RATE + int(jitter[k])
            header = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](stamp // NANO, stamp % NANO), "base_link"
            )
            message = types[KIND](header, names, *table[:, :, k].T.copy())
            writer.write(connection, stamp + 200_000, store.serialize_cdr(message, KIND))
    return path
