"""What the graph itself costs: processor time of every process, estimates a second, latency from sample to estimate.

    setup/run python benchmarks/graph.py --runs 3

Emulated robot, driver, filter and identifier are processes of their own, as on a robot; this one listens to
joint_params. The driver ends at 500 Hz, so at a higher rate `graph_source.py` publishes simulated joints. In the case
"receiving", the window is longer than the run: the identifier takes in and converts samples, and fits nothing. "load"
is the same with a description of the robot, from which the filter computes the load of every joint. In "rest" the robot
stands, and the estimates that are published say so. In the first 16 s
of motion all samples are fitted anew three times beside the recursion; `--after 25` leaves these out.

The share of a core is small on a computer that has no time for the nodes, so the time per sample that a node received
is given as well. Latency is the time from the stamp of the newest sample of an estimate to the instant at which the
estimate is published. It contains the lag of the filter. With `--parts` it is given in two parts, too: until
joint_samples are published, and from there on. To listen to these takes processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from cpu_time import cpu_s
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from joint_id_core.emulator.process import EmulatorProcess
from joint_id_core.emulator.robots import ROBOTS, build_joints
from joint_id_core.simulation.plants import PositionControl
from joint_id_msgs.msg import JointParams, JointSamples

DOMAIN = 1 + os.getpid() % 100
PATIENCE_S = 120.0  # until the first estimate: the first fit of a model compiles it
CASES = ("robot", "receiving", "load", "rest", "fast")
IDLE = ("receiving", "load", "rest")  # in which nothing is fitted
FAST_HZ = 1000.0
JOINTS = build_joints(ROBOTS[0])  # those of the emulator


def main() -> None:
    """Run the cases in turns and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES, help="(default: all)")
    parser.add_argument("--models", nargs="+", default=["motor_side", "harmonic_drive"], help="(default: both)")
    parser.add_argument("--hop", type=float, default=0.1, help="s between two estimates (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=15.0, help="s that are measured (default: %(default)s)")
    parser.add_argument(
        "--after", type=float, default=3.0, help="s from the first estimate until it is measured (default: %(default)s)"
    )
    parser.add_argument("--parts", action="store_true", help="the parts of the latency, too")
    parser.add_argument("--runs", type=int, default=1, help="of each case (default: %(default)s)")
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/graph.json"), help="(default: %(default)s)")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    runs = []
    for _ in range(args.runs):
        for case in args.cases:
            for model in args.models if case not in IDLE else args.models[:1]:
                runs.append(_measure(case, model, args.hop, args.duration, args.after, args.parts))
                print(_line(runs[-1]), flush=True)
    args.json.parent.mkdir(parents=True, exist_ok=True)
    args.json.write_text(json.dumps(runs, indent=1))


def _measure(case: str, model: str, hop: float, duration: float, after: float, parts: bool) -> dict[str, Any]:
    """Run one case and return its figures."""
    window = 600.0 if case in ("receiving", "load") else 2.0
    settings = {"model": model, "actuation": "current", "window_s": window, "hop_s": hop}
    with ExitStack() as stack:
        watcher = stack.enter_context(_watching(parts))
        folder = stack.enter_context(TemporaryDirectory())
        processes = {
            "filter": stack.enter_context(node("filter", {"urdf": _described(folder)} if case == "load" else {}))
        }
        if case == "fast":
            settings["set"] = listed([f"k_t={PositionControl.K_T!r}", "N=101"])
            processes["identifier"] = stack.enter_context(node("identifier", settings))
            command = ["--rate", str(FAST_HZ), "--duration", str(duration + PATIENCE_S)]
            processes["source"] = stack.enter_context(
                process([sys.executable, str(Path(__file__).with_name("graph_source.py")), *command])
            )
        else:
            settings["joints"] = listed([j.name for j in JOINTS])
            settings["set"] = listed([f"{j.name}.k_t={j.values['k_t']!r}" for j in JOINTS])
            processes["identifier"] = stack.enter_context(node("identifier", settings))
            moving = "none" if case == "rest" else "all"
            emulator = stack.enter_context(EmulatorProcess("--host", "127.0.0.1", "--moving", moving))
            processes["emulator"] = emulator.process
            address = {"robot_ip": emulator.host, "port": emulator.port}
            processes["driver"] = stack.enter_context(node("driver", address))
        if case in IDLE:
            watcher.spin_for(12.0)  # until all nodes have started and the filter has learnt the period
        else:
            watcher.wait_for_estimates()
            watcher.spin_for(after)
        watcher.clear()
        begun, before = time.monotonic(), {name: cpu_s(p.pid) for name, p in processes.items()}
        watcher.spin_for(duration)
        took = time.monotonic() - begun
        shares = {name: (cpu_s(p.pid) - before[name]) / took for name, p in processes.items()}
        latencies = 1e-6 * np.array(watcher.latencies_ns())
        of_filter, of_identifier = (1e-6 * np.array(some) for some in watcher.parts_ns())
    figures = {
        "case": case,
        "model": model,
        "asked": len(JOINTS) / hop,
        "updates": len(latencies) / took,
        "load": os.getloadavg()[0],
    }
    figures |= {f"{name} [%]": 100.0 * share for name, share in shares.items()}
    figures |= {f"{name} [us]": 1e6 * shares[name] / rate for name, rate in watcher.rates().items() if rate}
    for name, some in (("", latencies), ("to joint_samples ", of_filter), ("from there ", of_identifier)):
        if len(some):
            figures |= {f"{name}median [ms]": float(np.median(some)), f"{name}p99 [ms]": float(np.quantile(some, 0.99))}
    return figures


class _Watcher(Node):
    """Notes the stamp of each estimate and the instant of its publication."""

    def __init__(self, parts: bool) -> None:
        super().__init__("watcher")
        self.found: list[tuple[bytes, int]] = []  # messages, and when they were published
        self._samples: list[tuple[bytes, int]] = []  # the same of the samples that the estimates are made of
        self._received: dict[str, list[tuple[float, int]]] = {}  # by node, when and what it said to have received
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self.create_subscription(JointParams, "joint_params", self._on_params, qos, raw=True)
        if parts:
            self.create_subscription(JointSamples, "joint_samples", self._on_samples, qos, raw=True)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_params(self, message: bytes, info: Any) -> None:
        self.found.append((message, info["source_timestamp"]))

    def _on_samples(self, message: bytes, info: Any) -> None:
        self._samples.append((message, info["source_timestamp"]))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            count = next((int(v.value) for v in status.values if v.key == "received"), 0)
            self._received.setdefault(status.name.strip("/"), []).append((time.monotonic(), count))

    def clear(self) -> None:
        """Forget what was received so far."""
        self.found.clear()
        self._samples.clear()
        self._received.clear()

    def _estimates(self) -> Iterator[tuple[int, int]]:
        """Yield for each estimate the instants of its newest sample and of its publication, in ns.

        A message holds the newest estimates of all joints; those that an earlier message held are left out.
        """
        seen: dict[str, int] = {}
        for data, published_ns in self.found:
            for joint in deserialize_message(data, JointParams).joints:
                end_ns = _ns(joint.window_end)
                if joint.joint in seen and end_ns > seen[joint.joint]:
                    yield end_ns, published_ns
                seen[joint.joint] = end_ns

    def latencies_ns(self) -> list[int]:
        """Return for each estimate the time from its newest sample to its publication, in ns."""
        return [published_ns - end_ns for end_ns, published_ns in self._estimates()]

    def parts_ns(self) -> tuple[list[int], list[int]]:
        """Return the times until joint_samples were published, and for each estimate the time from there on, in ns."""
        sent = {_ns(deserialize_message(data, JointSamples).header.stamp): at_ns for data, at_ns in self._samples}
        lags = [at_ns - stamp_ns for stamp_ns, at_ns in sent.items()]
        return lags, [published_ns - sent[end_ns] for end_ns, published_ns in self._estimates() if end_ns in sent]

    def rates(self) -> dict[str, float]:
        """Return the samples a second that each node has received."""
        ends = {node: (said[0], said[-1]) for node, said in self._received.items() if len(said) > 1}
        return {node: (last[1] - first[1]) / (last[0] - first[0]) for node, (first, last) in ends.items()}

    def spin_for(self, duration: float) -> None:
        """Receive for a while."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self, timeout_sec=left)

    def wait_for_estimates(self) -> None:
        """Wait until estimates come."""
        end = time.monotonic() + PATIENCE_S
        while not self.found:
            rclpy.spin_once(self, timeout_sec=0.1)
            if time.monotonic() > end:
                raise SystemExit(f"no estimate within {PATIENCE_S:g} s")


def _ns(stamp: Any) -> int:
    """Return a stamp of ROS in ns."""
    return int(stamp.sec * 10**9 + stamp.nanosec)


@contextmanager
def _watching(parts: bool) -> Iterator[_Watcher]:
    rclpy.init()
    watcher = _Watcher(parts)
    try:
        yield watcher
    finally:
        watcher.destroy_node()
        rclpy.try_shutdown()


def node(name: str, parameters: dict[str, Any]) -> Any:
    """A node of joint_id_ros as a process."""
    script = Path(get_package_prefix("joint_id_ros")) / "lib/joint_id_ros" / name
    arguments = [a for key, value in parameters.items() for a in ("-p", f"{key}:={value}")]
    return process([sys.executable, str(script), *(["--ros-args", *arguments] if arguments else [])])


@contextmanager
def process(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is ended, if needed by force."""
    started = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.terminate()
        try:
            started.wait(10.0)
        except subprocess.TimeoutExpired:
            started.kill()
            started.wait()


def _described(folder: str) -> str:
    """Write the description of an arm with the joints of the robot, and return its path."""
    names, text = [j.name for j in JOINTS], '<link name="link_0"/>'
    for k, name in enumerate(names):
        text += (
            f'<link name="link_{k + 1}"><inertial><origin xyz="0.1 0 0.05"/><mass value="{6 - k}"/>'
            '<inertia ixx="0.03" iyy="0.04" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="link_{k}"/><child link="link_{k + 1}"/>'
            f'<origin xyz="0.2 0 0.1"/><axis xyz="{"0 1 0" if k % 2 else "0 0 1"}"/></joint>'
        )
    path = Path(folder) / "robot.urdf"
    path.write_text(f'<robot name="arm">{text}</robot>')
    return str(path)


def listed(texts: list[str]) -> str:
    """A list of texts as a ROS parameter."""
    return "[" + ", ".join(f'"{text}"' for text in texts) + "]"


def _line(run: dict[str, Any]) -> str:
    return "  ".join(f"{k} {v:.1f}" if isinstance(v, float) else f"{k} {v}" for k, v in run.items())


if __name__ == "__main__":
    main()
