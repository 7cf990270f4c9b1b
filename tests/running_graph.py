"""A running filter and identifier, and a publisher of link states in this process that never stops to move.

The joint is a rigid one under a multisine. Its motion repeats every two seconds, apart from a constant drift, so that a
test may go on for as long as it likes.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np
from robot_messages import NANO, stamp
from sensor_msgs.msg import JointState

from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples
from joint_id_ros.qos import LATEST, STREAM_OUT

RATE = 500
TRUTH = {"J": 2.0, "c": 8.0, "tau_f": 3.0, "tau_0": 0.7}
TONES = (0.5, 1.0, 1.5, 2.5, 4.0, 6.0)
PERIOD_S = 2  # of the motion
WINDOW_S = 2.0
CHUNK = 25  # messages between two looks at what comes back

Spoil = Callable[[JointState, int], None]


class Motion:
    """Position and torque of the joint at any sample."""

    def __init__(self) -> None:
        instants = np.arange(5 * PERIOD_S * RATE) / RATE
        torque = multisine(instants, 60.0, TONES, seed=1)
        position = simulate(build("rigid_joint"), instants, {"torque": torque}, TRUTH)["link_position"]
        self._torque, self._position = (values[-PERIOD_S * RATE :] for values in (torque, position))
        self._drift = float(position[-1] - position[-1 - PERIOD_S * RATE])
        self._rng = np.random.default_rng(2)

    def at(self, k: int) -> tuple[float, float]:
        """Measured position in rad and torque in Nm at sample k of 500 a second."""
        periods, rest = divmod(k, PERIOD_S * RATE)
        noise = self._rng.standard_normal(2) * (2e-5, 0.05)
        return self._position[rest] + periods * self._drift + noise[0], self._torque[rest] + noise[1]


class Graph:
    """Publishes samples and looks at what filter and identifier make of them."""

    def __init__(self, probe: Any, start: Callable[..., Any]) -> None:
        self.probe, self.start, self.motion = probe, start, Motion()
        self.k, self.step = 0, 1  # next sample of the motion, and samples from one message to the next
        self.shift_ns = 1000 * NANO  # of the publisher's clock
        self.names = ["joint"]
        self.found = probe.collect(JointParams, "joint_params", LATEST)
        self.samples = probe.collect(JointSamples, "joint_samples")
        self.filter = self.begin_filter()
        self.identifier = self.begin_identifier()
        self.publisher = probe.create_publisher(JointState, "link_states", STREAM_OUT)
        self.wait_for_readers()

    def begin_filter(self) -> Any:
        """Start a filter that takes efforts for torques at the link of a joint without a gear."""
        return self.start("filter", effort_source="torque", gear_ratio=1.0, join_wait_s=0.2)

    def begin_identifier(self) -> Any:
        """Start an identifier."""
        return self.start("identifier", model="rigid_joint", actuation="torque", window_s=WINDOW_S)

    def replace(self, node: str) -> None:
        """Kill a node and start another one, while the samples go on."""
        getattr(self, node).signal(signal.SIGKILL)
        getattr(self, node).wait()
        begin = {"filter": self.begin_filter, "identifier": self.begin_identifier}[node]
        setattr(self, node, begin())
        self.send_in_real_time(1.0)

    def pause(self, node: str, seconds: float) -> None:
        """Stop a node for a while, in which the samples go on."""
        getattr(self, node).signal(signal.SIGSTOP)
        self.send_in_real_time(seconds)
        getattr(self, node).signal(signal.SIGCONT)

    def wait_for_readers(self) -> None:
        """Wait until both nodes listen."""
        self.probe.until(lambda: self.publisher.get_subscription_count() >= 1, "the filter")
        self.probe.until(lambda: self.probe.count_subscribers("joint_samples") >= 2, "the identifier")

    @property
    def now_ns(self) -> int:
        """Stamp of the next message."""
        return self.shift_ns + self.k * NANO // RATE

    def message(self, k: int | None = None) -> JointState:
        """Message of the next sample, or of sample k."""
        k = self.k if k is None else k
        position, torque = self.motion.at(k)
        message = JointState(name=list(self.names), position=[position] * len(self.names))
        message.effort = [torque] * len(self.names)
        message.header.stamp = stamp(self.shift_ns + k * NANO // RATE)
        return message

    def send(self, seconds: float, spoil: Spoil | None = None, also: Iterable[Callable[[], None]] = ()) -> None:
        """Publish samples of so many seconds, faster than in real time; `spoil` changes every message."""
        for count in range(round(seconds * RATE / self.step)):
            message = self.message()
            if spoil is not None:
                spoil(message, count)
            self.publish(message)
            for other in also:
                other()
            self.k += self.step
            if count % CHUNK == CHUNK - 1:
                self.probe.spin(0.008)

    def send_until(self, condition: Callable[[], object], also: Iterable[Callable[[], None]] = ()) -> None:
        """Publish samples, of a minute at most, until the condition holds."""
        end = self.k + 60 * RATE
        while not condition() and self.k < end:
            self.send(0.5, also=also)

    def publish(self, message: JointState) -> None:
        """Publish one message; the middleware waits for room."""
        self.publisher.publish(message)

    def send_in_real_time(self, seconds: float) -> None:
        """Publish samples of so many seconds as a robot does."""
        begin, first = time.monotonic(), self.k
        while self.k < first + seconds * RATE:
            self.probe.spin(max(0.0, begin + (self.k - first) / RATE - time.monotonic()))
            for _ in range(CHUNK):
                self.publisher.publish(self.message())
                self.k += self.step

    def told(self, node: str, text: str) -> None:
        """Wait until the diagnostics of a node say this, and that something is wrong."""
        try:
            self.probe.until(lambda: self.probe.told(node, text), f"a diagnostic of {node} with {text!r}")
        except AssertionError as error:
            said = {status.message for status in self.probe.diagnostics if status.name == f"/{node}"}
            raise AssertionError("\n".join([str(error), "it said:", *sorted(said)])) from None
        status = self.probe.told(node, text)
        assert status.level in (b"\x01", b"\x02"), status.message

    def newest(self, name: str = "joint") -> JointEstimate | None:
        """The newest published estimate of a joint."""
        joints = {j.joint: j for j in self.found[-1].joints} if self.found else {}
        return joints.get(name)

    def estimate_of_now(
        self,
        name: str = "joint",
        also: Iterable[Callable[[], None]] = (),
        usable: Collection[int] = (JointEstimate.CONVERGED,),
    ) -> JointEstimate:
        """Go on until the estimate of a window that begins now has come, says something of the joint, and is usable."""
        begin_ns = self.now_ns
        # Samples of 50 s, sent faster than that: the checks take time. A second opinion looks back on 16 s of motion,
        # and is asked every 16 s: two of them may have a fault in them, which widens intervals.
        for _ in range(100):
            self.send(0.5, also=also)
            newest = self.newest(name)
            if newest is not None and self.now_ns - instant(newest.window_end) > WINDOW_S * NANO:
                self.probe.spin(0.5)  # a loaded computer: more samples would only wait
            if newest is not None and newest.status not in usable:
                continue  # a window with the fault in it
            if newest is not None and not says_something(newest):
                continue  # the fault may have cost the memory
            if newest is None or not begin_ns <= instant(newest.window_start) < self.now_ns:
                continue
            if instant(newest.window_end) - instant(newest.window_start) > 0.9 * WINDOW_S * NANO:  # not after a gap
                return newest
        raise AssertionError(f"no estimate of joint {name} after {begin_ns / NANO} s: {newest}")

    def right_again(self, name: str = "joint", also: Iterable[Callable[[], None]] = ()) -> None:
        """Go on until the estimate of a window that begins now has come, and see that it is right."""
        assert_true(self.estimate_of_now(name, also))


def instant(stamp_: Any) -> int:
    """A stamp in ns."""
    return int(stamp_.sec * NANO + stamp_.nanosec)


def says_something(estimate: JointEstimate) -> bool:
    """Whether the standard deviation of every parameter is small enough to say something of it."""
    return all(p.std_dev < 0.4 * TRUTH[p.name] for p in estimate.parameters if p.name in TRUTH)


def assert_true(estimate: JointEstimate) -> None:
    """Every parameter within 5 of its own standard deviations, and those small enough to say something."""
    assert estimate.status == JointEstimate.CONVERGED, estimate.message
    for p in estimate.parameters:
        if p.name in TRUTH:
            assert abs(p.value - TRUTH[p.name]) < 5.0 * p.std_dev, f"{p.name} {p.value} +- {p.std_dev}"
    assert says_something(estimate)
