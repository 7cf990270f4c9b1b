"""What the identifier knows outlives its process: kill -9, restart, and the services that save, load and reset it."""

import signal
import time

import numpy as np
import pytest
from robot_messages import NANO, stamp
from std_srvs.srv import Trigger

from joint_id_core.models import build
from joint_id_core.online.resume import DRIFT_PER_H
from joint_id_core.results.estimate import Status
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


@pytest.fixture
def joint(probe, start, tmp_path):
    """A joint in motion; its identifier keeps what it knows in a file."""
    return Samples(probe, start, tmp_path / "state.json")


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


def test_kill_9_costs_at_most_two_seconds_of_knowledge(joint):
    rng = np.random.default_rng()
    joint.begin()
    joint.identify()
    for _ in range(2):
        joint.send_in_real_time(rng.uniform(0.2, 1.5))
        joint.kill()
        joint.probe.spin(0.2)
        seen, known = joint.newest(), joint.stored()
        assert known.estimate.status is Status.CONVERGED
        assert_lost_little(joint, seen, known)
        count = len(joint.found)
        joint.begin()
        joint.probe.until(lambda count=count: len(joint.found) > count, "the restored estimate")
        assert_restored(joint, joint.found[count], known)
        begun = BEGIN + joint.k * NANO // RATE
        joint.send(1.3)  # shorter than a window
        good = joint.until(lambda e, t=begun: e.status == JointEstimate.CONVERGED and instant(e.window_start) >= t)
        assert_right(good)
        gone_s = time.time() - known.watched_s  # a slow computer takes longer to hear the first sample
        for name, deviation in std_devs(good).items():
            assert deviation < 1.2 * widened(known.estimate[name].std_dev, name, gone_s)


@pytest.mark.long
def test_50_random_moments(joint, record_property):
    rng, lost, first = np.random.default_rng(), [], []
    joint.begin()
    joint.send_in_real_time(4.0)
    for _ in range(50):
        joint.send_in_real_time(rng.uniform(0.0, 3.0))
        joint.kill()
        joint.probe.spin(0.1)
        seen, known = joint.newest(), joint.stored()
        lost.append(assert_lost_little(joint, seen, known))
        assert known.estimate.status is Status.CONVERGED
        for name, value in TRUTH.items():
            assert abs(known.estimate[name].value - value) < 6.0 * known.estimate[name].std_dev
        count, begun = len(joint.found), time.monotonic()
        joint.begin()
        joint.probe.until(lambda count=count: len(joint.found) > count, "the restored estimate")
        first.append(time.monotonic() - begun)
        assert_restored(joint, joint.found[count], known)
    figures = f"lost s: median {np.median(lost):.2f}, worst {max(lost):.2f}; restored after s: {np.median(first):.2f}"
    record_property("figures", figures)
    print(figures)


def test_a_stopped_node_writes_its_last_estimate(joint):
    joint.begin()
    joint.identify()
    joint.identifier.signal(signal.SIGTERM)
    assert joint.identifier.wait() == 0
    seen, known = joint.newest(), joint.stored()
    assert instant(seen.parameters_end) <= known.origin_ns + known.estimate.end * NANO + 1000
    assert not list(joint.state.parent.glob("*.part"))


def test_save_load_and_reset(joint):
    joint.begin()
    joint.identify()
    answer = joint.ask("save")
    assert answer.success and answer.message == f"saved 1 joint to {joint.state}"
    saved = joint.stored()
    joint.send(2.0)
    joint.until(lambda e: instant(e.parameters_end) > saved.origin_ns + (saved.estimate.end + 1.0) * NANO, "more")
    answer = joint.ask("load")
    assert answer.success and answer.message == f"loaded 1 joint from {joint.state}"
    joint.until(lambda e: "Restored from" in e.message, "the loaded estimate")
    joint.send(1.3)
    assert_right(joint.until(lambda e: e.status == JointEstimate.CONVERGED, "an estimate"))

    answer = joint.ask("reset")
    assert answer.success and answer.message == f"forgot 1 joint and deleted {joint.state}"
    joint.probe.until(lambda: not joint.found[-1].joints, "that nothing is known")
    assert not joint.state.exists()
    answer = joint.ask("load")
    assert not answer.success and "there is no such file" in answer.message
    joint.send(1.3)  # shorter than a window
    joint.probe.spin(0.3)
    assert joint.newest() is None or joint.newest().parameters_status != JointEstimate.CONVERGED
    assert not joint.state.exists()


def test_cleanup_keeps_what_is_known_and_reset_forgets_it(joint):
    joint.begin(state_file="")
    answer = joint.ask("save")
    assert not answer.success and "set the parameter state_file and configure" in answer.message
    joint.identify()
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        assert joint.probe.change("identifier", transition)
    joint.until(lambda e: "Restored " in e.message, "the estimate of before")
    joint.send(1.3)
    assert_right(joint.until(lambda e: e.status == JointEstimate.CONVERGED, "an estimate"))
    assert joint.probe.change("identifier", "deactivate")
    assert joint.ask("reset").message == "forgot 1 joint"
    assert joint.probe.change("identifier", "activate")
    count = len(joint.found)
    joint.send(1.3)
    joint.probe.spin(0.3)
    assert all(j.parameters_status != JointEstimate.CONVERGED for m in joint.found[count:] for j in m.joints)


def test_what_cannot_be_used_is_named_and_the_joint_starts_anew(joint):
    joint.state.write_text("{")
    joint.begin()
    kept = joint.state.with_name("state.json.damaged")
    joint.probe.until(lambda: joint.probe.told("identifier", f"It is kept as {kept}"), "a diagnostic")
    assert joint.probe.told("identifier", f"It is kept as {kept}").level == b"\x02"
    joint.identify()
    joint.probe.until(lambda: joint.state.exists(), "a new file")
    assert kept.read_text() == "{"
    joint.kill()
    joint.begin(fix=["tau_0=0.7"])
    text = "what was known of it cannot be used: the settings are others now (fixed, values)"
    joint.probe.until(lambda: joint.probe.told("identifier", text), "a diagnostic")
    assert text in joint.identifier.text
    begun = BEGIN + joint.k * NANO // RATE
    joint.send(2.3)
    assert_right(joint.until(lambda e: instant(e.window_start) >= begun, "an estimate"))


def test_two_nodes_with_one_file_are_told(joint, start, probe):
    joint.begin()
    joint.identify()
    start("identifier", "-r", "__node:=other", model="rigid_joint", actuation="torque", state_file=str(joint.state))
    probe.until(lambda: probe.told("other", "is in use by another node"), "a diagnostic")
    assert not probe.call(Trigger, "/other/save", Trigger.Request()).success


@pytest.mark.long
def test_restored_joints_that_are_not_there_any_more_are_taken_back(joint):
    joint.begin()
    joint.send(2.2, ("joint", "tool"))
    joint.probe.until(lambda: joint.newest("tool") is not None, "an estimate")
    assert joint.ask("save").success
    joint.kill()
    joint.begin()
    joint.send(2.5)
    joint.probe.until(lambda: joint.newest("joint") is not None and joint.newest("tool") is None, "its end")
    assert "tool" in StateFile(str(joint.state)).read()  # it may come back
