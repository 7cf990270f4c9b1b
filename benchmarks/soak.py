"""Hours of a robot: six emulated joints at 500 Hz through driver, filter and identifier, which must not grow or err.

    setup/run python benchmarks/soak.py --minutes 120

Every process is a process of its own, as in `graph.py`. Once a second the resident memory, threads and open files of
each are read. Of every estimate the largest error over its standard deviation is taken, against the true parameters of
the emulator, and hops without an estimate are counted. The first minutes are left out: libraries load, the memory of
the identifier fills with what it keeps of the newest samples.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from graph import DOMAIN, JOINTS, PATIENCE_S, listed, node
from measured_blocks import write
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from joint_id_core.emulator.process import EmulatorProcess
from joint_id_msgs.msg import JointEstimate, JointParams, ParameterEstimate

HOP_S = 0.5
WARM_UP_S = 300.0  # until the memory of the identifier is full: 64 s of motion, with the emulator's rests 220 s
PART = 0.1  # of the time at the begin and at the end whose medians are compared
FLAT, FAR = 0.03, 4.0
MODEL = "harmonic_drive"


@dataclass
class Use:
    """What a process uses, once a second: resident memory in MB, threads, open files."""

    memory: list[float] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)

    def read(self, pid: int) -> None:
        """Take the present numbers."""
        status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
        self.memory.append(float(status["VmRSS"].split()[0]) / 1024.0)
        self.threads.append(int(status["Threads"]))
        self.files.append(len(list(Path(f"/proc/{pid}/fd").iterdir())))

    def summary(self) -> dict[str, Any]:
        """Memory at begin and end, the growth between them, and the ranges of threads and files."""
        part = max(1, round(PART * len(self.memory)))
        first, last = (float(np.median(v)) for v in (self.memory[:part], self.memory[-part:]))
        return {
            "memory_mb": [first, last],
            "growth": last / first - 1.0,
            "threads": [min(self.threads), max(self.threads)],
            "files": [min(self.files), max(self.files)],
        }


class Listener(Node):
    """Compares every estimate with the truth."""

    def __init__(self) -> None:
        super().__init__("soak")
        self.truth = {joint.name: joint.values for joint in JOINTS}
        self.clear()
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self.create_subscription(JointParams, "joint_params", self._on_params, qos)
        self._ends: dict[str, float] = {}

    def clear(self) -> None:
        """Forget what was counted so far."""
        self.estimates = self.missed = self.not_converged = 0
        self.worst = (0.0, "")

    def _on_params(self, message: JointParams) -> None:
        for joint in message.joints:
            end = joint.window_end.sec + 1e-9 * joint.window_end.nanosec
            before = self._ends.get(joint.joint)
            if end == before:
                continue  # another joint is new in this message
            self._ends[joint.joint] = end
            self.estimates += 1
            self.missed += 0 if before is None else max(0, round((end - before) / HOP_S) - 1)
            if joint.status == JointEstimate.CONVERGED:
                self._compare(joint)
            else:
                self.not_converged += 1

    def _compare(self, joint: JointEstimate) -> None:
        for p in joint.parameters:
            if p.verdict == ParameterEstimate.ESTIMATED:
                off = abs(p.value - self.truth[joint.joint][p.name]) / p.std_dev
                self.worst = max(self.worst, (off, f"{joint.joint}.{p.name}"))


def soak(minutes: float, warm_up_s: float) -> dict[str, Any]:
    """Run the graph, and return what the processes used and how right the estimates were after the warm-up."""
    parameters = {
        "model": MODEL, "actuation": "current", "hop_s": HOP_S,
        "joints": listed([j.name for j in JOINTS]),
        "set": listed([f"{j.name}.k_t={j.values['k_t']!r}" for j in JOINTS]),
    }  # fmt: skip
    rclpy.init()
    listener = Listener()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        stack.callback(listener.destroy_node)
        processes = {
            "filter": stack.enter_context(node("filter", {})),
            "identifier": stack.enter_context(node("identifier", parameters)),
        }
        emulator = stack.enter_context(EmulatorProcess("--host", "127.0.0.1"))
        address = {"robot_ip": emulator.host, "port": emulator.port}
        processes |= {"driver": stack.enter_context(node("driver", address)), "emulator": emulator.process}
        _wait(listener)
        _spin(listener, warm_up_s, {}, {})
        listener.clear()
        uses = {name: Use() for name in processes}
        _spin(listener, 60.0 * minutes, {name: p.pid for name, p in processes.items()}, uses)
    return {
        "minutes": minutes, "joints": len(JOINTS), "load": os.getloadavg()[0], "estimates": listener.estimates,
        "missed": listener.missed, "not_converged": listener.not_converged, "largest": listener.worst[0],
        "worst": listener.worst[1], "processes": {name: use.summary() for name, use in uses.items()},
        "use": {name: asdict(use) for name, use in uses.items()},
    }  # fmt: skip


def _wait(listener: Listener) -> None:
    end = time.monotonic() + PATIENCE_S
    while not listener.estimates:
        rclpy.spin_once(listener, timeout_sec=0.1)
        if time.monotonic() > end:
            raise SystemExit(f"no estimate within {PATIENCE_S:g} s")


def _spin(listener: Listener, seconds: float, pids: dict[str, int], uses: dict[str, Use]) -> None:
    """Receive for a while; read once a second what the processes use."""
    begun = time.monotonic()
    due = begun
    while time.monotonic() < begun + seconds:
        rclpy.spin_once(listener, timeout_sec=0.1)
        if time.monotonic() >= due:
            due += 1.0
            for name, pid in pids.items():
                uses[name].read(pid)


def table(found: dict[str, Any]) -> str:
    """What the processes used, and a sentence on the estimates."""
    lines = [
        "| process | memory, begin | end | growth | threads | open files |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, use in found["processes"].items():
        first, last = use["memory_mb"]
        ranges = (f"{a}" if a == b else f"{a} to {b}" for a, b in (use["threads"], use["files"]))
        lines.append(
            f"| `{name}` | {first:.1f} MB | {last:.1f} MB | {100 * use['growth']:+.1f} % | {' | '.join(ranges)} |"
        )
    said = (
        f"{found['minutes']:g} minutes, {found['joints']} joints: {found['estimates']} estimates, {found['missed']} "
        f"hops without one, {found['not_converged']} not converged; largest error over sigma {found['largest']:.1f} "
        f"(`{found['worst']}`)."
    )
    return "\n".join([*lines, "", said])


def main() -> None:
    """Run, print and write a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0, help="that are measured (default: %(default)s)")
    parser.add_argument("--warm-up", type=float, default=WARM_UP_S, help="s before, left out (default: %(default)s)")
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/soak.json"), help="(default: %(default)s)")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmarks.md")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    found = soak(args.minutes, args.warm_up)
    print(table(found))
    args.json.parent.mkdir(parents=True, exist_ok=True)
    args.json.write_text(json.dumps(found, indent=1))
    if args.docs:
        write("benchmarks.md", {"soak": table(found)})


if __name__ == "__main__":
    main()
