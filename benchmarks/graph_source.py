"""The publisher of the benchmark of the graph: simulated joints at any rate, in a process of its own.

The driver of a robot ends at 500 Hz. This process publishes what it would: link position, current and motor velocity
of several joints, with the noise of a UR robot's sensors. The signals are simulated before the first one is published,
and the messages are published as bytes, so that it takes little processor time from the nodes under test.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import rclpy
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from joint_id_core.simulation.plants import MotionOptions, PositionControl
from joint_id_core.simulation.sensors import ur_robot_sensors
from joint_id_ros.conversions import to_stamp
from joint_id_ros.qos import STREAM_OUT

TICK_S = 0.002  # longest sleep between two messages


def main() -> None:
    """Simulate, then publish in real time until the signals end."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--joints", type=int, default=6, help="number of joints (default: %(default)s)")
    parser.add_argument("--rate", type=float, default=1000.0, help="Hz (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=30.0, help="s (default: %(default)s)")
    args = parser.parse_args()
    links, motors = _signals(args.joints, args.rate, round(args.rate * args.duration))
    rclpy.init()
    node = rclpy.create_node("source")
    outputs = [node.create_publisher(JointState, name, _qos(args.rate)) for name in ("link_states", "motor_states")]
    while not all(output.get_subscription_count() for output in outputs):
        time.sleep(0.01)
    print("ready", flush=True)
    begin_ns, begin = time.time_ns(), time.monotonic()
    names = [f"joint_{k}" for k in range(1, args.joints + 1)]
    for k in range(len(links)):
        while time.monotonic() - begin < k / args.rate:
            time.sleep(min(TICK_S, 0.5 / args.rate))
        stamp = to_stamp(begin_ns + round(1e9 * k / args.rate))
        link = JointState(name=names, position=links[k, 0], effort=links[k, 1])
        motor = JointState(name=names, velocity=motors[k])
        for output, message in zip(outputs, (link, motor), strict=True):
            message.header.stamp = stamp
            output.publish(serialize_message(message))
    time.sleep(1.0)
    node.destroy_node()
    rclpy.shutdown()


def _qos(rate: float) -> QoSProfile:
    """Keep as many seconds of samples for a slow reader as the driver does."""
    return QoSProfile(depth=round(STREAM_OUT.depth * rate / 500.0), reliability=STREAM_OUT.reliability)


def _signals(joints: int, rate: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position and current (count, 2, joints), and motor velocity (count, joints), with the sensors' noise."""
    plant = PositionControl({}, MotionOptions(), seed=0)
    sensors, rng = ur_robot_sensors(plant.values["N"]), np.random.default_rng(0)
    true = {name: np.empty(count) for name in ("link_position", "current", "motor_velocity")}
    for k in range(count):
        row = plant.tick(1.0 / rate)
        for name, values in true.items():
            values[k] = row[name]
    read = {n: np.stack([sensors.reading(n, v, rng) for _ in range(joints)], axis=-1) for n, v in true.items()}
    return np.stack([read["link_position"], read["current"]], axis=1), read["motor_velocity"]


if __name__ == "__main__":
    main()
