"""How soon a cancelled identification stops the emulated robot, through the nodes `identify` and `emulated_motion`.

    setup/run python benchmarks/cancel.py --times 30

Emulator and nodes are processes of their own. A goal is sent, its go is given, and at a random moment of the motion
it is cancelled. Measured from the instant before the cancel is sent: the publication of the stop, its arrival
here, and the first sample in which all targets of the robot are at rest (they brake within 0.2 s). Every bag is read.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rclpy
from graph import DOMAIN, PATIENCE_S, listed, node
from rclpy.action import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from joint_id_core import formats
from joint_id_core.design.files import write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.emulator.process import EmulatorProcess
from joint_id_core.emulator.robots import HOME
from joint_id_core.rtde.fields import JOINT_NAMES
from joint_id_msgs.action import Identify
from joint_id_msgs.msg import RobotSignals
from joint_id_ros.qos import STREAM_IN
from joint_id_ros.trajectories import QOS

SECONDS = 20.0


class Canceller(Node):
    """A client of the action, which sees the stop and the targets of the robot."""

    def __init__(self) -> None:
        super().__init__("canceller")
        self.client = ActionClient(self, Identify, "identify")
        self.go = self.create_client(Trigger, "identify/go")
        self.phase = 0
        self.stops: list[tuple[float, float]] = []  # published, arrived, s since the epoch
        self.speeds: list[tuple[float, float]] = []  # arrived, s since the epoch; largest speed of a target, rad/s
        self.create_subscription(JointTrajectory, "joint_trajectory", self._on_order, QOS)
        self.create_subscription(RobotSignals, "robot_signals", self._on_signals, STREAM_IN)

    def _on_order(self, message: Any, info: Any) -> None:
        if not message.points:
            self.stops.append((info["source_timestamp"] * 1e-9, time.time()))

    def _on_signals(self, message: Any) -> None:
        if message.target_qd:
            self.speeds.append((time.time(), float(np.abs(message.target_qd).max())))

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Spin until a condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f"waited in vain for {what}")
            rclpy.spin_once(self, timeout_sec=0.05)

    def one(self, file: Path, after_s: float) -> dict[str, float]:
        """Cancel one goal so long after its joints began to move; return times in ms."""
        self.phase = 0
        sent = self.client.send_goal_async(
            Identify.Goal(trajectory=str(file)), lambda m: setattr(self, "phase", m.feedback.phase)
        )
        self.until(sent.done, "an answer to the goal")
        self.until(lambda: self.phase == Identify.Feedback.WAITING_FOR_GO, "the plan")
        self.go.call_async(Trigger.Request())
        self.until(lambda: self.speeds[-1][1] > 0.01, "a motion")
        end = time.monotonic() + after_s
        while time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.01)
        self.stops.clear()
        begun = time.time()
        sent.result().cancel_goal_async()
        self.until(lambda: self.stops, "the stop")
        self.until(lambda: self.speeds[-1][1] == 0.0, "rest")
        waited = sent.result().get_result_async()
        self.until(waited.done, "the result")
        rest = next(at for at, speed in self.speeds if at > begun and speed == 0.0)
        formats.read(Path(waited.result().result.bag), JOINT_NAMES[0])
        self.speeds = self.speeds[-1:]
        published, arrived = self.stops[0]
        return {
            "published": 1e3 * (published - begun),
            "arrived": 1e3 * (arrived - begun),
            "rest": 1e3 * (rest - begun),
        }


def main() -> None:
    """Cancel many goals, and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--times", type=int, default=30, help="(default: %(default)s)")
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/cancel.json"), help="(default: %(default)s)")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(2, len(JOINT_NAMES), 3)) * 0.05
    motion = FourierMotion(JOINT_NAMES, np.array(HOME), *waves, np.array([0.2, 0.5, 0.9]), SECONDS, 2.0)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        file, socket = folder / "motion.csv", folder / "robot"
        write(motion.sampled(125.0), file)
        emulator = stack.enter_context(EmulatorProcess("--moving", "none", "--socket", str(socket)))
        extra = {"robot_ip": emulator.host, "port": emulator.port, "extra_fields": listed(["target_qd"])}
        stack.enter_context(node("driver", extra))
        stack.enter_context(node("emulated_motion", {"socket": str(socket)}))
        stack.enter_context(node("identify", {"directory": str(folder), "silent_s": 20.0}))
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        client = Canceller()
        client.until(lambda: client.speeds and client.client.server_is_ready(), "the nodes")
        client.until(lambda: client.go.service_is_ready() and client.count_subscribers("joint_trajectory") > 1, "them")
        end = time.monotonic() + 2.0
        client.until(lambda: time.monotonic() > end, "discovery")
        rows = [client.one(file, after) for after in rng.uniform(3.0, 8.0, args.times).tolist()]
    print(f"{'from the cancel to':<28}{'median':>10}{'worst':>10}   (of {len(rows)}, load {os.getloadavg()[0]:.0f})")
    for name, what in (
        ("published", "stop published"),
        ("arrived", "stop seen by a third"),
        ("rest", "targets at rest"),
    ):
        values = [row[name] for row in rows]
        print(f"  {what:<26}{np.median(values):>7.1f} ms{max(values):>7.1f} ms")
    args.json.parent.mkdir(parents=True, exist_ok=True)
    args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
