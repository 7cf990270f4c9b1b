"""What the demo sees of the running system: estimates and truth from their topics, and the table it shows of them."""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from joint_id_core.errors import JointIdError
from joint_id_msgs.msg import JointEstimate, JointParams, ParameterEstimate
from joint_id_ros.conversions import STATUS_CODES, VERDICT_CODES, nanoseconds
from joint_id_ros.qos import LATEST

VERDICTS = {code: verdict.value.replace("_", " ") for verdict, code in VERDICT_CODES.items()}
STATUSES = {code: status.value.replace("_", " ") for status, code in STATUS_CODES.items()}
HEAD = f"  {'':<9}{'unit':<9}{'estimate':>12} ± {'std dev':<8}{'truth':>10}{'error':>10}   verdict"
WIDTH = 79  # of a narrow terminal
ANSWER_S = 20.0  # longest wait for the answer of a node
PLAIN_EVERY = 10  # estimates between two tables where the terminal cannot be written over


@dataclass
class History:
    """Estimates of one joint in the order in which they came, and the truth."""

    truth: dict[str, float] = field(default_factory=dict)
    begin_ns: int = 0  # stamp at which the motion began
    estimates: list[JointEstimate] = field(default_factory=list)
    before: dict[str, float] = field(default_factory=dict)  # truth before the joint changed
    changed_s: float = math.nan  # s of motion after which it changed

    def time(self, estimate: JointEstimate) -> float:
        """End of an estimate's window in s of motion."""
        return (nanoseconds(estimate.window_end) - self.begin_ns) / 1e9

    @property
    def moved_s(self) -> float:
        """End of the newest window in s of motion; 0 before the first estimate."""
        return self.time(self.estimates[-1]) if self.estimates else 0.0

    @property
    def known_s(self) -> float:
        """End of the first window with a good estimate in s of motion; infinity while there is none."""
        return next((self.time(e) for e in self.estimates if e.status == JointEstimate.CONVERGED), math.inf)

    def error(self, p: ParameterEstimate) -> float:
        """Error of a parameter in its own standard deviations; NaN where there is none."""
        return (p.value - self.truth.get(p.name, math.nan)) / p.std_dev if p.std_dev > 0.0 else math.nan


def free(estimate: JointEstimate) -> list[ParameterEstimate]:
    """The parameters that were estimated, in the model's order."""
    return [p for p in estimate.parameters if p.name in estimate.free]


class Watcher:
    """Subscribes to `joint_params` and `truth` and fills the `History` of one joint.

    Attributes:
        history: of the joint.
        latest: last estimate by joint, of all joints.
    """

    def __init__(self, joint: str = "joint") -> None:
        self.history = History()
        self.latest: dict[str, JointEstimate] = {}
        self._joint = joint
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("demo", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_subscription(JointParams, "truth", self._on_truth, LATEST)
        self._node.create_subscription(JointParams, "joint_params", self._on_params, LATEST)
        self._said: dict[str, Any] = {}
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def __enter__(self) -> Watcher:
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            self._said[status.name.strip("/")] = status

    def said_by(self, node: str, *keys: str) -> str:
        """The latest sentence of a node on /diagnostics, with some of its values."""
        if node not in self._said:
            return "nothing"
        values = {v.key: v.value for v in self._said[node].values}
        return ", ".join([self._said[node].message, *(f"{key} {values.get(key, '?')}" for key in keys)])

    def _on_truth(self, message: Any) -> None:
        history = self.history
        for joint in message.joints:
            since_ns = nanoseconds(joint.window_start)
            if history.truth:
                history.before, history.changed_s = history.truth, (since_ns - history.begin_ns) / 1e9
            else:
                history.begin_ns = since_ns
            history.truth = {p.name: p.value for p in joint.parameters}

    def _on_params(self, message: Any) -> None:
        for estimate in message.joints:
            before = self.latest.get(estimate.joint)
            self.latest[estimate.joint] = estimate
            # A message repeats the last estimates of the other joints.
            if estimate.joint == self._joint and (before is None or before.window_end != estimate.window_end):
                self.history.begin_ns = self.history.begin_ns or nanoseconds(estimate.window_start)
                self.history.estimates.append(estimate)

    def identifier_listens(self) -> bool:
        """Whether the identifier is ready for samples."""
        return self._node.count_subscribers("joint_samples") > 0

    def set_parameter(self, node: str, name: str, value: object) -> None:
        """Set a parameter of a node.

        Raises:
            JointIdError: the node refuses it or does not answer.
        """
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        client = self._node.create_client(SetParameters, f"{node}/set_parameters")
        client.wait_for_service(ANSWER_S)
        future = client.call_async(request)
        self._executor.spin_until_future_complete(future, ANSWER_S)
        if not future.done():
            raise JointIdError(f"{node} did not answer within {ANSWER_S:g} s when {name} was set")
        (result,) = future.result().results
        if not result.successful:
            raise JointIdError(f"{node} refused {name} = {value}: {result.reason}")

    def spin(self, seconds: float = 0.1) -> None:
        """Read what has arrived; wait for it at most this long."""
        self._executor.spin_once(timeout_sec=seconds)


def table(history: History, estimate: JointEstimate, title: str) -> list[str]:
    """The estimate and the truth, as lines of text."""
    state = STATUSES.get(estimate.status, "?")
    lines = [
        f"{title}: {history.time(estimate):.1f} s of motion, estimate {len(history.estimates)}, {state}, "
        f"fitted in {estimate.solve_time:.2f} s",
        HEAD,
    ]
    for p in free(estimate):
        truth, error = history.truth.get(p.name, math.nan), history.error(p)
        lines.append(
            f"  {p.name:<9}{p.unit:<9}{_rounded(p.value, p.std_dev):>12} ± {p.std_dev:<8.1e}{truth:>10.4g}"
            f"{error:>+8.1f} σ   {VERDICTS.get(p.verdict, '?')}"
        )
    held = [f"{p.name} = {p.value:.4g}" for p in estimate.parameters if p.name not in estimate.free]
    text = f"held at known values: {', '.join(held)}"
    return [*lines, *textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="  ")]


def summary(latest: Mapping[str, JointEstimate], truth: Mapping[str, Mapping[str, float]], names: Sequence[str]) -> str:
    """A few parameters of all joints, with their truth."""
    head = "".join(f"{f'{name} (truth)':>32}" for name in names)
    lines = [f"  {'joint':<20}{'status':<12}{head}"]
    for joint, values in truth.items():
        estimate = latest.get(joint)
        if estimate is None:
            lines.append(f"  {joint:<20}no estimate")
            continue
        found = {p.name: p for p in estimate.parameters}
        cells = (
            f"{_rounded(p.value, p.std_dev)} ± {p.std_dev:.1e} ({values[n]:.4g})" for n in names if (p := found[n])
        )
        lines.append(f"  {joint:<20}{STATUSES.get(estimate.status, '?'):<12}" + "".join(f"{c:>32}" for c in cells))
    return "\n".join(lines)


def _rounded(value: float, std_dev: float) -> str:
    """A value with the digits that its standard deviation leaves, and one more."""
    if not (math.isfinite(value) and value and std_dev > 0.0):
        return f"{value:.4g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(std_dev)) + 2
    return f"{value:#.{min(max(digits, 2), 8)}g}"


class Screen:
    """Shows the table while it changes: written over in a terminal, appended now and then elsewhere."""

    def __init__(self, title: str, begun: float) -> None:
        """`begun` is the instant on time.monotonic() from which the wait for the first estimate counts."""
        self._title, self._begun, self._live = title, begun, sys.stdout.isatty()
        self._shown, self._lines = 0, 0

    def show(self, history: History) -> None:
        """Show what is new."""
        if len(history.estimates) == self._shown or not history.truth:
            return
        latest, first = history.estimates[-1], self._shown == 0
        self._shown = len(history.estimates)
        if first:
            print(f"first estimate after {time.monotonic() - self._begun:.1f} s", flush=True)
        if self._live:
            self._write_over(table(history, latest, self._title))
        elif first or self._shown % PLAIN_EVERY == 0:
            print("\n".join(table(history, latest, self._title)), flush=True)
        else:
            print(table(history, latest, self._title)[0], flush=True)

    def finish(self, history: History) -> None:
        """Leave the last table on the screen."""
        if not self._live and history.estimates:
            print("\n".join(table(history, history.estimates[-1], f"{self._title}, at the end")), flush=True)

    def _write_over(self, lines: list[str]) -> None:
        columns = shutil.get_terminal_size().columns - 1  # a line that wraps would count as two
        up = f"\x1b[{self._lines}F" if self._lines else ""
        print(up + "".join(f"\x1b[2K{line[:columns]}\n" for line in lines), end="", flush=True)
        self._lines = len(lines)
