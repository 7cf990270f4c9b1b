"""A fleet of robots whose joints are identified, for the benchmark: its processes, and what its nodes say."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from fleet_robots import RATE
from graph import JOINTS, node, process
from rclpy.node import Node
from rclpy.qos import QoSProfile

from joint_id_core.simulation.plants import PositionControl
from joint_id_ros.robots_file import read_robots

HOP_S = 0.5
SETTINGS = {
    "params_file": "ur3e", "rate": float(RATE), "joints": [j.name for j in JOINTS], "window_s": 2.0, "hop_s": HOP_S,
    "set": [f"k_t={PositionControl.K_T!r}", "N=101"],
}  # fmt: skip
PATIENCE_S = 180.0
ROBOTS = Path(__file__).with_name("fleet_robots.py")


@contextmanager
def running_fleet(
    count: int, parts: int, after: float, duration: float
) -> Iterator[tuple[Watcher, dict[str, list[int]], int]]:
    """A watcher, numbers of the processes by kind, and that of the process that plays the robots.

    Args:
        count: of robots.
        parts: processes that share them; 0: every node has one.
        after: s that pass from the first estimates of all.
        duration: s for which the robots move afterwards.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        command = [sys.executable, str(ROBOTS), "--robots", str(count)]
        command += ["--duration", str(after + duration)]
        source = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        stack.callback(source.wait)
        stack.callback(source.terminate)
        ports = source.stdout.readline().split() if source.stdout else []
        robots = [
            {"name": f"cell_{k // 4 + 1}/ur_{k % 4}", "robot_ip": "127.0.0.1", "port": int(port)}
            for k, port in enumerate(ports)
        ]
        (path := folder / "robots.yaml").write_text(yaml.safe_dump({"all": SETTINGS, "robots": robots}))
        watcher = stack.enter_context(watching())
        processes: dict[str, list[int]] = {}
        if parts:
            processes["fleet"] = [
                stack.enter_context(node("fleet", {"robots": path, "processes": parts, "part": k + 1})).pid
                for k in range(parts)
            ]
        else:
            for robot in read_robots(path):
                for start in robot.starts:
                    given = folder / f"{robot.name.replace('/', '_')}_{start.name}.yaml"
                    given.write_text(start.given_text)
                    command = [_script(start.name), "--ros-args", "-r", f"__ns:=/{robot.name}"]
                    for file in [*start.files, str(given)]:
                        command += ["--params-file", file]
                    one = stack.enter_context(process([sys.executable, *command]))
                    processes.setdefault(start.name, []).append(one.pid)
        watcher.wait_for(count)
        watcher.spin_for(after)
        yield watcher, processes, source.pid


class Watcher(Node):
    """Reads what the nodes say of themselves."""

    def __init__(self) -> None:
        super().__init__("watcher")
        self._newest: dict[str, dict[str, str]] = {}
        self.lag_s = 0.0
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=1000))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._newest[status.name] = values = {v.key: v.value for v in status.values}
            self.lag_s = max(self.lag_s, float(values.get("lag of the estimates [s]", 0.0)))

    @property
    def identifiers(self) -> list[dict[str, str]]:
        """What identifiers said last."""
        return [values for name, values in self._newest.items() if name.endswith("/identifier")]

    @property
    def converged(self) -> int:
        """Joints whose newest window was explained."""
        said = [text for values in self.identifiers for key, text in values.items() if key.endswith(": status")]
        return sum(text.startswith("Converged") for text in said)

    def counts(self) -> dict[str, int]:
        """Samples that identifiers received, their fits, and samples that anything on their way has lost."""
        total = {"samples": 0, "fits": 0, "lost": 0}
        for name, values in self._newest.items():
            for key, text in values.items():
                if name.endswith("/identifier") and key == "received":
                    total["samples"] += int(text)
                elif key.startswith("fits: "):
                    total["fits"] += int(text)
                elif key in ("lost", "samples left out") or ": lost by " in key:
                    total["lost"] += int(text)
        return total

    def spin_for(self, duration: float) -> None:
        """Receive for a while."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self, timeout_sec=left)

    def wait_for(self, robots: int) -> None:
        """Wait until all robots are identified."""
        end = time.monotonic() + PATIENCE_S
        while sum(any(k.startswith("fits: ") for k in values) for values in self.identifiers) < robots:
            rclpy.spin_once(self, timeout_sec=0.1)
            if time.monotonic() > end:
                raise SystemExit(f"{len(self.identifiers)} of {robots} robots have an estimate within {PATIENCE_S:g} s")


@contextmanager
def watching() -> Iterator[Watcher]:
    rclpy.init()
    watcher = Watcher()
    try:
        yield watcher
    finally:
        watcher.destroy_node()
        rclpy.try_shutdown()


def _script(name: str) -> str:
    return str(Path(get_package_prefix("joint_id_ros")) / "lib/joint_id_ros" / name)


def memory_mb(pid: int) -> float:
    """Resident memory of a process in MB, with its part of what it shares."""
    rows = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
    return int(rows["Pss"].split()[0]) / 1024.0
