"""Nodes as separate processes, each test on a ROS domain of its own, and a probe that talks to them."""

from __future__ import annotations

import functools
import gc
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_process import PATIENCE_S, Process
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from ros_domain import own_domain

from joint_id_core.emulator.process import EmulatorProcess
from joint_id_ros.qos import REPLAY, STREAM_IN

AGAIN_S = 5.0  # a service is asked again after that
ASKED_BY_ONE = 4  # times that a client asks: one that its server has not found once is not found for minutes
DEMO = Path(__file__).resolve().parent.parent / "demo/demo.py"
DEMO_S = 300.0  # a limit for a demo that hangs, not a measure of speed
REACHED = {"configure": "inactive", "activate": "active", "deactivate": "inactive", "cleanup": "unconfigured",
           "shutdown": "finalized"}  # fmt: skip


# Shells let their background jobs ignore SIGINT, and so would every process that these start.
signal.signal(signal.SIGINT, signal.default_int_handler)


class Source:
    """A publisher that a slow reader holds up."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher

    def publish(self, message: Any) -> None:
        """Publish, once there is room."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                self._publisher.publish(message)
                return
            except RuntimeError:  # rclpy's RCLError, after the middleware has waited for room
                assert time.monotonic() < end, f"nobody takes the messages on {self._publisher.topic_name}"


class Probe(Node):
    """A node in the test process."""

    def __init__(self, context: Context) -> None:
        super().__init__("probe", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        self.diagnostics: list[Any] = []
        self._clients_by_service: dict[str, Any] = {}
        self.create_subscription(DiagnosticArray, "/diagnostics", lambda m: self.diagnostics.extend(m.status), 1000)

    def destroy_node(self) -> None:
        """Leave the domain now: what waits for a topic or an action would keep both open until it is collected."""
        self._executor.shutdown()
        for client in [w for w in self.waitables if isinstance(w, ActionClient)]:
            client.destroy()
        super().destroy_node()

    def collect(self, kind: Any, topic: str, qos: QoSProfile = STREAM_IN, delay_s: float = 0.0) -> list[Any]:
        """A list that fills with the messages of a topic, read with a delay before each.

        One wake-up takes all that has arrived: the executor alone is slower than the nodes under test.
        """
        messages: list[Any] = []

        def read(message: Any) -> None:
            with subscription.handle:
                taken = (message, None)
                while taken is not None:
                    time.sleep(delay_s)
                    messages.append(taken[0])
                    taken = subscription.handle.take_message(kind, False)

        subscription = self.create_subscription(kind, topic, read, qos)
        return messages

    def collect_headers(self) -> list[tuple[str, float]]:
        """A list that fills with node name and stamp in s of every diagnostic report."""
        found: list[tuple[str, float]] = []

        def note(message: Any) -> None:
            found.append((message.status[0].name, message.header.stamp.sec + message.header.stamp.nanosec * 1e-9))

        self.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        return found

    def source(self, kind: Any, topic: str) -> Source:
        """A publisher that has found its subscriber, and waits for it instead of losing messages."""
        publisher = self.create_publisher(kind, topic, REPLAY)
        self.until(lambda: publisher.get_subscription_count() > 0, f"a subscriber on {topic}")
        return Source(publisher)

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Spin until the condition holds; the test fails when it never does."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}"
            self._executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        """Let messages come in for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Result of a service; asked again when no answer comes: one is lost when the server does not know us yet."""
        return self._ask(kind, service, request)[0]

    def ask_until(self, kind: Any, service: str, request: Any, condition: Callable[[], object]) -> None:
        """Ask a service, again when nothing happens, until the condition holds, whether it has answered or not."""
        self._ask(kind, service, request, condition)

    def _ask(
        self, kind: Any, service: str, request: Any, enough: Callable[[], object] | None = None
    ) -> tuple[Any, int]:
        """Result of a service, and how often it was asked for; no result where `enough` holds before."""
        end, futures, heard = time.monotonic() + PATIENCE_S, list[Any](), len(self.diagnostics)

        def settled() -> object:
            return enough() if enough is not None else any(future.done() for future in futures)

        while not settled():
            meanwhile = Counter(status.name for status in self.diagnostics[heard:])
            assert time.monotonic() < end, f"{service} does not answer; meanwhile diagnostics of {dict(meanwhile)}"
            if service not in self._clients_by_service or (futures and len(futures) % ASKED_BY_ONE == 0):
                self._make_client(kind, service)
            futures.append(self._clients_by_service[service].call_async(request))
            again = time.monotonic() + AGAIN_S
            while time.monotonic() < again and not settled():
                self._executor.spin_once(timeout_sec=0.05)
        return next((future.result() for future in futures if future.done()), None), len(futures)

    def _make_client(self, kind: Any, service: str) -> None:
        """A client of a service, in place of one that the server never came to know."""
        if service in self._clients_by_service:
            print(f"{service} has not answered {ASKED_BY_ONE} times: another client asks")
        client = self._clients_by_service[service] = self.create_client(kind, service)
        self.until(client.service_is_ready, service)
        self.spin(0.5)  # mostly long enough for the server to know us

    def change(self, node: str, transition: str) -> bool:
        """Ask a lifecycle node to "configure", "activate", ...; whether it did."""
        request = ChangeState.Request(transition=Transition(label=transition))
        answer, times = self._ask(ChangeState, f"/{node}/change_state", request)
        # Of two requests the second is refused where the first was carried out.
        return bool(answer.success) or (times > 1 and self.state(node) == REACHED[transition])

    def state(self, node: str) -> str:
        """State of a lifecycle node."""
        return str(self.call(GetState, f"/{node}/get_state", GetState.Request()).current_state.label)

    def set_parameter(self, node: str, name: str, value: object) -> Any:
        """Set a parameter of a node; the result says whether it took it, else why not."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, f"/{node}/set_parameters", request).results[0]

    def told(self, node: str, text: str) -> Any:
        """The first diagnostic status of a node whose message or values contain the text, else None."""
        for status in self.diagnostics:
            if status.name == f"/{node}" and any(
                text in t for t in (status.message, *(v.value for v in status.values))
            ):
                return status
        return None

    def values_of(self, node: str) -> dict[str, str]:
        """The values of the newest diagnostic status of a node; none before the first."""
        of_node = [status for status in self.diagnostics if status.name == f"/{node}"]
        return {v.key: v.value for v in of_node[-1].values} if of_node else {}


@functools.cache
def _spare_the_libraries() -> None:
    """Leave out of later collections what the libraries hold, which takes half a second."""
    gc.collect()
    gc.freeze()


def _collect() -> None:
    _spare_the_libraries()
    gc.collect()


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain for this test alone, also among test runs and demos at the same time on this machine."""
    _collect()  # nodes that earlier tests had in this process leave the domain when their contexts are collected
    with own_domain() as number:
        yield number


@pytest.fixture
def kind() -> type[Process]:
    """How nodes are started; `Program` in the files that are about their start or end."""
    return Process


@pytest.fixture
def start(tmp_path: Path, domain: int, kind: type[Process]) -> Iterator[Callable[..., Process]]:
    """Start nodes: `start("filter", "--ros-args", ..., gear_ratio=50.0)`; parameters are keywords."""
    processes: list[Process] = []

    def begin(name: str, *ros_arguments: str, **parameters: object) -> Process:
        arguments = [*ros_arguments]
        for key, value in parameters.items():
            arguments += ["-p", f"{key}:={_yaml(value)}"]
        output = tmp_path / f"{len(processes)}_{name}.log"
        processes.append(kind(name, output, ["--ros-args", *arguments] if arguments else []))
        return processes[-1]

    yield begin
    for process in processes:
        process.stop()
        print(f"--- {process.name} ---\n{process.text}")  # shown by pytest when the test fails


@pytest.fixture
def robot() -> Iterator[Callable[..., EmulatorProcess]]:
    """Start emulated robots: `robot("--version", "3.15")`."""
    robots: list[EmulatorProcess] = []

    def begin(*arguments: str, port: int = 0) -> EmulatorProcess:
        robots.append(EmulatorProcess("--port", str(port), *arguments))
        return robots[-1]

    yield begin
    for one in robots:
        one.stop()
        print("--- robot ---", *one.lines, *one.complaints, sep="\n")  # shown by pytest when the test fails


@pytest.fixture
def probe(domain: int) -> Iterator[Probe]:
    """A node in this process, on the domain of the test."""
    context = Context()
    rclpy.init(context=context)
    node = Probe(context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start the demo with everything that it writes in a temporary folder; ended at the latest with the test."""
    started: list[subprocess.Popen[str]] = []

    def begin(*arguments: str, program: Sequence[str] = (str(DEMO),)) -> subprocess.Popen[str]:
        command = [sys.executable, *program, "--out", tmp_path / "out", "--picture", tmp_path / "demo.png"]
        pipe = subprocess.PIPE
        started.append(subprocess.Popen([*command, *arguments], stdout=pipe, stderr=subprocess.STDOUT, text=True))
        return started[-1]

    yield begin
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=DEMO_S)


def _yaml(value: object) -> str:
    """A parameter value as the command line takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else str(v) for v in value) + "]"
    return str(value) or '""'
