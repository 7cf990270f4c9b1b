"""A rigid joint that moves for ever, an identifier that keeps in a file what it knows of it, and checks of both."""

import signal
import time

import numpy as np
import pytest
from robot_messages import NANO, stamp
from std_srvs.srv import Trigger

from joint_id_core.models import build
from joint_id_core.online.resume import DRIFT_PER_H
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate
from joint_id_core.stored.state_file import StateFile
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples
from joint_id_ros.qos import LATEST, STREAM_OUT

RATE = 500
TRUTH = {"J": 2.0, "c": 8.0, "tau_f": 3.0, "tau_0": 0.7}
NOISE = {"link_position": 2e-5, "link_velocity": 1.5e-3, "torque": 0.05}
PERIOD_S = 2
UNITS = {**TRUTH, "tau_0": next(p.spread for p in build("rigid_joint").parameters if p.name == "tau_0")}
LOST_S = 2.0  # of knowledge at most
BEGIN = 1000 * NANO


class Samples:
    """A rigid joint that moves for ever, as messages, and what an identifier publishes of it."""

    def __init__(self, probe, start, state):
        time_ = np.arange(5 * PERIOD_S * RATE) / RATE
        torque = multisine(time_, 60.0, (0.5, 1.0, 1.5, 2.5, 4.0, 6.0), seed=1)
        moved = simulate(build("rigid_joint"), time_, {"torque": torque}, TRUTH)
        last = slice(-PERIOD_S * RATE, None)
        self.channels = {n: moved[n][last] for n in NOISE}
        self.drift = float(moved["link_position"][-1] - moved["link_position"][-1 - PERIOD_S * RATE])
        self.rng, self.k, self.zero = np.random.default_rng(2), 0, None
        self.probe, self.start, self.state = probe, start, state
        self.found = probe.collect(JointParams, "joint_params", LATEST)
        self.publisher = probe.create_publisher(JointSamples, "joint_samples", STREAM_OUT)

    def begin(self, **parameters):
        """Start an identifier."""
        given = {"model": "rigid_joint", "actuation": "torque", "state_file": str(self.state), **parameters}
        before = self.readers()  # a killed one is taken for alive for a while
        self.identifier = self.start("identifier", **given)
        self.probe.until(lambda: self.readers() - before, "the identifier")
        self.probe.spin(0.2)
        self.begun_s = None

    def readers(self):
        """Subscriptions of the samples, dead ones included."""
        return {tuple(r.endpoint_gid) for r in self.probe.get_subscriptions_info_by_topic("joint_samples")}

    def kill(self):
        """End it in the middle of whatever it does."""
        self.killed_s = time.time()
        self.identifier.signal(signal.SIGKILL)
        self.identifier.wait()

    def message(self, names=("joint",)):
        """The next sample."""
        periods, rest = divmod(self.k, PERIOD_S * RATE)
        noisy = {n: self.channels[n][rest] + std * self.rng.standard_normal() for n, std in NOISE.items()}
        noisy["link_position"] += periods * self.drift
        message = JointSamples(name=list(names), **{n: [v] * len(names) for n, v in noisy.items()})
        message.header.stamp = stamp(BEGIN + self.k * NANO // RATE)
        message.measured = JointSamples.LINK_POSITION | JointSamples.LINK_VELOCITY | JointSamples.TORQUE
        self.k += 1
        return message

    def send(self, seconds, names=("joint",)):
        """Publish samples of so many seconds, faster than in real time."""
        self.begun_s = self.begun_s or time.time()
        for k in range(round(seconds * RATE)):
            self.publisher.publish(self.message(names))
            if k % 50 == 49:
                self.probe.spin(0.02)

    def send_in_real_time(self, seconds):
        """Publish samples as a robot does, whose time went on while nobody listened."""
        self.begun_s = self.begun_s or time.time()  # of the first sample of a run: before it there is nothing to lose
        if self.zero is None:
            self.zero = time.monotonic() - self.k / RATE
        end = time.monotonic() + seconds
        self.k = max(self.k, round((time.monotonic() - self.zero) * RATE))
        while (now := time.monotonic()) < end:
            while self.k < (now - self.zero) * RATE:
                self.publisher.publish(self.message())
            self.probe.spin(0.004)

    def newest(self, name="joint"):
        """The newest published estimate of a joint."""
        joints = {j.joint: j for j in self.found[-1].joints} if self.found else {}
        return joints.get(name)

    def until(self, condition, what="an estimate"):
        """Spin until the newest estimate is such."""
        self.probe.until(lambda: self.newest() is not None and condition(self.newest()), what)
        return self.newest()

    def identify(self, seconds=2.2):
        """Identify the joint for a while."""
        self.send(seconds)
        return self.until(lambda e: e.status == JointEstimate.CONVERGED, "an estimate")

    def ask(self, service):
        """Answer of one of the services."""
        return self.probe.call(Trigger, f"/identifier/{service}", Trigger.Request())

    def stored(self):
        """The estimate in the file; a new reader, as after a crash."""
        return StateFile(str(self.state)).read()["joint"]


def instant(time_):
    return time_.sec * NANO + time_.nanosec


def assert_right(estimate):
    """Every parameter within 5 of its own standard deviations, and those small."""
    for p in estimate.parameters:
        if p.name in estimate.free:
            assert abs(p.value - TRUTH[p.name]) < 5.0 * p.std_dev < 0.5 * TRUTH[p.name], p


def std_devs(estimate):
    return {p.name: p.std_dev for p in estimate.parameters if p.name in TRUTH}


def widened(std_dev, name, gone_s):
    """Standard deviation of a parameter that nobody watched for a while."""
    return np.hypot(std_dev, DRIFT_PER_H * gone_s / 3600.0 * UNITS[name])


def assert_restored(joint, published, known):
    """What was published first after a restart: the stored estimate with its age, not called tested."""
    first = published.joints[0]
    assert first.status == JointEstimate.TOO_SHORT and first.samples == 0
    assert f"Restored from {joint.state}, " in first.message and "s old" in first.message
    assert first.parameters_status == JointEstimate.CONVERGED
    assert first.age > 0.0
    assert instant(first.window_end) - instant(first.parameters_end) == pytest.approx(first.age * NANO, abs=1000)
    assert instant(first.parameters_end) == pytest.approx(known.origin_ns + known.estimate.end * NANO, abs=1000)
    assert {p.name: p.value for p in first.parameters} == pytest.approx(known.estimate.values)
    for name, deviation in std_devs(first).items():
        assert deviation == pytest.approx(widened(known.estimate[name].std_dev, name, first.age), rel=1e-3)


def assert_lost_little(joint, seen, known):
    """The file holds what was published last, or at most `LOST_S` of this run are not in it."""
    same = instant(seen.parameters_end) == pytest.approx(known.origin_ns + known.estimate.end * NANO, abs=1000)
    lost = 0.0 if same else joint.killed_s - max(known.watched_s, joint.begun_s)
    assert lost < LOST_S
    return lost
