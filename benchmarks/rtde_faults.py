"""What every fault of a robot costs: samples missing from link_states, and how long until they flow again.

    setup/run python benchmarks/rtde_faults.py

Emulator and driver node are processes of their own; this one listens to link_states and /diagnostics over DDS. A sample
is missing when two stamps that follow each other are more than one period apart. Recovery counts from the end of the
fault (of a cut: from the cut) to the arrival of the first sample behind the longest gap.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from joint_id_core.emulator.process import EmulatorProcess
from joint_id_ros.conversions import nanoseconds
from joint_id_ros.qos import STREAM_IN

PERIOD_S = 0.002
SETTLE_S = 2.0  # of undisturbed stream around a fault
PATIENCE_S = 30.0
DOMAIN = 1 + os.getpid() % 100

# What is done: command, time in s, command ... ; the last time is how long the fault itself lasts.
FAULTS: dict[str, list[tuple[str, float]]] = {
    "nothing": [("fragment off", 0.0)],
    "one sample not sent": [("drop 1", 0.002)],
    "50 samples not sent": [("drop 50", 0.1)],
    "silence of 0.3 s": [("stall 0.3", 0.3)],
    "silence of 2 s": [("stall 2", 2.0)],
    "connection cut": [("kill", 0.0)],
    "controller restarted, away 3 s": [("power-cycle 3", 3.0)],
    "arm powered off for 2 s": [("power-off", 2.0), ("power-on", 0.0)],
    "protective stop for 2 s": [("protective-stop", 2.0), ("unlock", 0.0)],
    "5 samples all zero": [("zero 5", 0.01)],
    "5 samples with NaN": [("nan 5", 0.01)],
    "controller clock +10 s": [("clock-jump 10", 0.0)],
    "controller clock -10 s": [("clock-jump -10", 0.0)],
    "64 bytes of garbage": [("garbage 64", 0.0)],
    "packets split and glued": [("fragment on", 2.0), ("fragment off", 0.0)],
}


@dataclass
class Result:
    """What one fault cost."""

    missing: int
    longest_gap_ms: float
    recovery_ms: float
    backwards: int
    said: str


class Listener:
    """Stamps and arrival times of link_states, and what the driver says."""

    def __init__(self) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=DOMAIN)
        self._node = Node("benchmark", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.stamps: list[int] = []
        self.arrivals: list[float] = []
        self.said: list[str] = []
        self._subscription = self._node.create_subscription(JointState, "link_states", self._on_links, STREAM_IN)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_links(self, message: JointState) -> None:
        now = time.monotonic()
        with self._subscription.handle:
            taken = (message, None)
            while taken is not None:
                self.stamps.append(nanoseconds(taken[0].header.stamp))
                self.arrivals.append(now)
                taken = self._subscription.handle.take_message(JointState, False)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.said += [status.message for status in message.status if status.level != b"\0"]

    def spin(self, seconds: float) -> None:
        """Listen for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def clear(self) -> None:
        """Forget what was heard, but for the last sample."""
        self.stamps, self.arrivals, self.said = self.stamps[-1:], self.arrivals[-1:], []

    def close(self) -> None:
        """End the node."""
        self._node.destroy_node()
        self._context.try_shutdown()


def main() -> None:
    """Run every fault in turn and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"), help="folder (default: %(default)s)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    script = Path(get_package_prefix("joint_id_ros")) / "lib/joint_id_ros/driver"
    results = {}
    print(f"{'fault':<34}{'missing':>8}{'longest gap':>13}{'recovery':>12}{'backwards':>11}   /diagnostics")
    with EmulatorProcess() as emulator, (args.out / "rtde_faults.log").open("w") as log:
        arguments = ["--ros-args", "-p", f"robot_ip:={emulator.host}", "-p", f"port:={emulator.port}"]
        driver = subprocess.Popen([sys.executable, str(script), *arguments], env=environment, stdout=log, stderr=log)
        listener = Listener()
        try:
            while not listener.stamps:
                listener.spin(0.1)
                if driver.poll() is not None:
                    raise SystemExit(f"the driver ended: see {log.name}")
            listener.spin(SETTLE_S)
            for name, actions in FAULTS.items():
                result = results[name] = _measure(listener, emulator, actions)
                print(
                    f"{name:<34}{result.missing:>8}{result.longest_gap_ms:>10.0f} ms{result.recovery_ms:>9.0f} ms"
                    f"{result.backwards:>11}   {result.said}",
                    flush=True,
                )
        finally:
            listener.close()
            driver.send_signal(signal.SIGINT)
            driver.wait()
    (args.out / "rtde_faults.json").write_text(json.dumps({k: asdict(v) for k, v in results.items()}, indent=1))


def _measure(listener: Listener, emulator: EmulatorProcess, actions: list[tuple[str, float]]) -> Result:
    listener.clear()
    begun = time.monotonic()
    for command, seconds in actions:
        emulator.give(command)
        listener.spin(seconds)
        if seconds:
            begun = time.monotonic()
    heard = len(listener.arrivals)
    limit = time.monotonic() + PATIENCE_S
    while not any(a > begun for a in listener.arrivals[heard:]):
        listener.spin(0.02)
        if time.monotonic() > limit:
            raise SystemExit(f"no sample {PATIENCE_S:g} s after {actions}")
    listener.spin(SETTLE_S)
    gaps = [(b - a) * 1e-9 for a, b in zip(listener.stamps, listener.stamps[1:], strict=False)]
    longest = gaps.index(max(gaps))
    resumed = listener.arrivals[longest + 1]
    return Result(
        missing=sum(max(0, round(gap / PERIOD_S) - 1) for gap in gaps),
        longest_gap_ms=1e3 * gaps[longest],
        recovery_ms=1e3 * max(0.0, resumed - begun) if gaps[longest] > 1.5 * PERIOD_S else 0.0,
        backwards=sum(gap <= 0.0 for gap in gaps),
        said=next(iter(listener.said), "-"),
    )


if __name__ == "__main__":
    main()
