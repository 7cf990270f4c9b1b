"""Node `identifier`: true parameters from clean samples, and a clear word about everything else."""

import numpy as np
import pytest
from robot_messages import NANO, stamp

from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples, ParameterEstimate
from joint_id_ros.qos import LATEST

RATE = 500
TRUTH = {"J": 2.0, "c": 8.0, "tau_f": 3.0, "tau_0": 0.7}
NOISE = {"link_position": 2e-5, "link_velocity": 1.5e-3, "torque": 0.05}


@pytest.fixture(scope="module")
def motion():
    """A rigid joint that never rests for long, as rows of measured channels."""
    time = np.arange(8 * RATE) / RATE
    torque = multisine(time, 60.0, (0.5, 1.0, 1.5, 2.5, 4.0, 6.0), seed=1)
    recording = simulate(build("rigid_joint"), time, {"torque": torque}, TRUTH)
    rng = np.random.default_rng(2)
    return {name: recording[name] + std * rng.standard_normal(len(time)) for name, std in NOISE.items()}


@pytest.fixture
def sample(motion):
    """Build the message of sample k for named joints."""

    def build_message(k, names=("joint",), begin=1000 * NANO):
        message = JointSamples(name=list(names))
        message.header.stamp = stamp(begin + k * NANO // RATE)
        message.link_position = [motion["link_position"][k]] * len(names)
        message.link_velocity = [motion["link_velocity"][k]] * len(names)
        message.torque = [motion["torque"][k]] * len(names)
        message.measured = JointSamples.LINK_POSITION | JointSamples.LINK_VELOCITY | JointSamples.TORQUE
        return message

    return build_message


@pytest.fixture
def identifying(start, probe):
    """Start an identifier of a rigid joint and return what it publishes and a publisher of samples."""

    def begin(**parameters):
        found = probe.collect(JointParams, "joint_params", LATEST)
        start("identifier", **{"model": "rigid_joint", "actuation": "torque", **parameters})
        return found, probe.source(JointSamples, "joint_samples")

    return begin


def latest(found, name="joint"):
    """The newest estimate of a joint, or None."""
    joints = {j.joint: j for j in found[-1].joints} if found else {}
    return joints.get(name)


def assert_true(estimate):
    """Every free parameter within 5 of its own standard deviations, and those small enough to say something."""
    assert estimate.status == JointEstimate.CONVERGED, estimate.message
    for p in estimate.parameters:
        if p.name in TRUTH:
            assert p.verdict == ParameterEstimate.ESTIMATED
            assert abs(p.value - TRUTH[p.name]) < 5.0 * p.std_dev
            assert p.std_dev < 0.1 * TRUTH[p.name]


def publish(publisher, probe, messages):
    """Publish at a pace that a busy machine can follow."""
    for k, message in enumerate(messages):
        publisher.publish(message)
        if k % 50 == 49:
            probe.spin(0.02)


def test_two_joints_are_identified_and_published_together(identifying, probe, sample):
    found, samples = identifying()
    publish(samples, probe, [sample(k, ("elbow", "wrist")) for k in range(4 * RATE)])
    probe.until(lambda: latest(found, "elbow") and latest(found, "wrist"), "estimates of both joints")
    for name in ("elbow", "wrist"):
        e = latest(found, name)
        assert_true(e)
        assert e.model == "rigid_joint" and e.estimator == "innovations"
        assert len(e.covariance) == len(e.free) ** 2
        assert (e.window_end.sec * NANO + e.window_end.nanosec) - (
            e.window_start.sec * NANO + e.window_start.nanosec
        ) == pytest.approx(2 * NANO, abs=0.1 * NANO)
    newest = max(j.window_end.sec * NANO + j.window_end.nanosec for j in found[-1].joints)
    assert found[-1].header.stamp.sec * NANO + found[-1].header.stamp.nanosec == newest


def test_a_late_subscriber_gets_the_last_estimate(identifying, probe, sample):
    found, samples = identifying()
    publish(samples, probe, [sample(k) for k in range(2 * RATE + 50)])
    probe.until(lambda: latest(found), "an estimate")
    probe.spin(1.0)
    late = probe.collect(JointParams, "joint_params", LATEST)
    probe.until(lambda: late, "the last estimate")
    # By their text, as NaN equals nothing. A busy computer may publish one more meanwhile.
    assert repr(late[0]) in map(repr, found[-2:])


@pytest.mark.parametrize("how", [{"end_with": "probe"}, {"recorded": True}, {"use_sim_time": True}])
def test_the_last_estimate_of_a_source_that_has_an_end_or_pauses_stays(identifying, probe, sample, how):
    found, samples = identifying(**how)
    publish(samples, probe, [sample(k) for k in range(2 * RATE + 50)])
    probe.until(lambda: latest(found), "an estimate")
    probe.spin(3.5)
    assert latest(found) is not None and not probe.told("identifier", "no joint_samples for")


def standing(message):
    message.link_position, message.link_velocity, message.torque = [0.5], [0.0], [0.0]
    return message


def test_a_failed_fit_keeps_the_last_good_estimate_for_late_subscribers(identifying, probe, sample):
    found, samples = identifying()
    publish(samples, probe, [sample(k) for k in range(2 * RATE + 50)])
    probe.until(lambda: latest(found), "an estimate")
    assert_true(latest(found))
    good = latest(found)
    publish(samples, probe, [standing(sample(k)) for k in range(2 * RATE + 50, 5 * RATE)])
    probe.until(lambda: latest(found).status == JointEstimate.NO_MOTION, "an estimate of a joint that stands")
    late = probe.collect(JointParams, "joint_params", LATEST)
    probe.until(lambda: late, "what a late subscriber gets")
    (joint,) = late[0].joints
    assert joint.status == JointEstimate.NO_MOTION and "move the joint" in joint.message
    assert joint.parameters_status == JointEstimate.CONVERGED
    end, window_end = (t.sec + t.nanosec / NANO for t in (joint.parameters_end, joint.window_end))
    assert end >= good.parameters_end.sec + good.parameters_end.nanosec / NANO
    assert joint.age == pytest.approx(window_end - end) and joint.age > 0.0
    for p in joint.parameters:
        if p.name in TRUTH:
            assert abs(p.value - TRUTH[p.name]) < 5.0 * p.std_dev < 0.5 * TRUTH[p.name]
    assert len(joint.covariance) == len(joint.free) ** 2 == len(TRUTH) ** 2
    # A run that begins anew knows nothing of the one before: it may be another robot.
    publish(samples, probe, [standing(sample(k, begin=500 * NANO)) for k in range(3 * RATE)])
    probe.until(lambda: found[-1].header.stamp.sec < 600, "an estimate of the second run")
    assert latest(found).parameters_status == latest(found).status == JointEstimate.NO_MOTION
    assert latest(found).age == 0.0


def test_only_the_chosen_joints_are_identified_and_a_missing_one_is_named(identifying, probe, sample):
    found, samples = identifying(joints=["elbow", "shoulder"])
    publish(samples, probe, [sample(k, ("elbow", "wrist")) for k in range(3 * RATE)])
    probe.until(lambda: latest(found, "elbow"), "an estimate")
    text = "joint shoulder is not in joint_samples (it has elbow, wrist)"
    probe.until(lambda: probe.told("identifier", text), "word of the missing joint")
    assert [j.joint for j in found[-1].joints] == ["elbow"]


def driven_by_current(message):
    message.current = [message.torque[0] / 0.08]
    message.torque, message.measured = [], message.measured ^ (JointSamples.TORQUE | JointSamples.CURRENT)
    return message


@pytest.mark.parametrize(("spoken", "change"), [([""], lambda m: m), (["k_t=0.08", "N=1"], driven_by_current)])
def test_what_drives_the_joint_follows_from_what_is_measured(identifying, probe, sample, spoken, change):
    found, samples = identifying(actuation="", set=spoken)
    publish(samples, probe, [change(sample(k)) for k in range(2 * RATE + 50)])
    probe.until(lambda: latest(found), "an estimate")
    assert_true(latest(found))


def test_each_joint_has_its_own_torque_constant(identifying, probe, sample):
    constants = {"elbow": 8.0, "wrist": 5.0}  # at N 1, so that the current is one of a robot
    joints = tuple(constants)
    texts = ["k_t=8", "N=1", "wrist.k_t=5"]
    found, samples = identifying(actuation="current", set=texts, joints=joints)
    messages = [sample(k, joints) for k in range(4 * RATE)]
    for message in messages:
        message.current = [message.torque[0] / k_t for k_t in constants.values()]
        message.torque, message.measured = [], message.measured ^ (JointSamples.TORQUE | JointSamples.CURRENT)
    publish(samples, probe, messages)
    probe.until(lambda: latest(found, "elbow") and latest(found, "wrist"), "estimates of both joints")
    for name, k_t in constants.items():
        assert_true(latest(found, name))
        assert {p.name: p.value for p in latest(found, name).parameters}["k_t"] == k_t


def test_a_joint_that_only_a_value_names_and_that_is_not_there_is_told(identifying, probe, sample):
    found, samples = identifying(set=["shoulder.J=3"])
    publish(samples, probe, [sample(k, ("elbow",)) for k in range(2 * RATE + 50)])
    probe.until(lambda: latest(found, "elbow"), "an estimate")
    text = "joint shoulder is not in joint_samples (it has elbow): check parameters joints, set, fix, free"
    probe.until(lambda: probe.told("identifier", text), "word of the missing joint")


def repeated(message):
    message.header.stamp = stamp(message.header.stamp.sec * NANO + message.header.stamp.nanosec - NANO // RATE)


def wrong_length(message):
    message.torque = [1.0, 2.0, 3.0]


def infinite(message):
    message.link_position = [float("inf")]


def huge(message):
    message.torque = [1e300]


def without_values(message):
    message.link_position, message.link_velocity, message.torque = [], [], []


def unnamed(message):
    message.name = []


BAD = {
    repeated: "the stamp repeats",
    wrong_length: "3 values of torque for 1 joints",
    infinite: "link_position of joint joint is infinite",
    huge: "torque of joint joint is 1e+300",
    without_values: "holds no values",
    unnamed: "names no joint",
}


def test_bad_samples_are_reported_and_identification_goes_on(identifying, probe, sample):
    found, samples = identifying()
    step = 4 * RATE // len(BAD)
    for k, (spoil, text) in enumerate(BAD.items()):
        publish(samples, probe, [sample(i) for i in range(k * step, (k + 1) * step)])
        bad = sample((k + 1) * step)
        spoil(bad)
        samples.publish(bad)
        probe.until(lambda text=text: probe.told("identifier", text), f"a diagnostic with {text!r}")
    publish(samples, probe, [sample(i) for i in range(len(BAD) * step, 6 * RATE)])
    probe.until(lambda: found and found[-1].header.stamp.sec >= 1005, "an estimate of the last samples")
    assert_true(latest(found))


def test_nan_samples_are_missing_ones(identifying, probe, sample):
    found, samples = identifying()
    messages = [sample(k) for k in range(4 * RATE)]
    for k in range(100, 4 * RATE, 7):
        messages[k].link_position = [float("nan")]
        messages[k + 2 if k + 2 < len(messages) else k].torque = [float("nan")]
    publish(samples, probe, messages)
    probe.until(lambda: latest(found), "an estimate")
    assert_true(latest(found))


def test_a_joint_that_does_not_move_is_told_so_and_identified_when_it_does(identifying, probe, sample):
    found, samples = identifying()
    still = [sample(k) for k in range(3 * RATE)]
    for message in still:
        message.link_position, message.link_velocity, message.torque = [0.5], [0.0], [0.0]
    publish(samples, probe, still)
    probe.until(lambda: latest(found), "an estimate")
    assert latest(found).status == JointEstimate.NO_MOTION
    assert "move the joint" in latest(found).message
    probe.until(lambda: probe.told("identifier", "move the joint"), "a diagnostic")
    publish(samples, probe, [sample(k) for k in range(3 * RATE, 7 * RATE)])
    probe.until(lambda: latest(found).status == JointEstimate.CONVERGED, "an estimate in motion")


def test_a_model_whose_input_is_not_there_says_which(identifying, probe, sample):
    found, samples = identifying(actuation="current", set=["k_t=0.1"])
    publish(samples, probe, [sample(k) for k in range(3 * RATE)])
    probe.until(lambda: latest(found), "an estimate")
    assert latest(found).status == JointEstimate.MISSING_SIGNAL
    assert "current" in latest(found).message


def test_a_second_run_with_earlier_stamps_is_identified_anew(identifying, probe, sample):
    found, samples = identifying()
    publish(samples, probe, [sample(k) for k in range(3 * RATE)])
    probe.until(lambda: latest(found), "an estimate of the first run")
    publish(samples, probe, [sample(k, begin=500 * NANO) for k in range(3 * RATE)])
    probe.until(lambda: found[-1].header.stamp.sec < 600, "an estimate of the second run")
    assert_true(latest(found))
    probe.until(lambda: probe.told("identifier", "identification starts anew"), "a report")


def test_a_lifecycle_manager_mends_the_configuration_and_starts_the_node(start, probe, sample):
    start("identifier", model="rigid_joint", actuation="torque", set=["mass=3"], autostart=False)
    found = probe.collect(JointParams, "joint_params", LATEST)
    assert not probe.change("identifier", "configure")
    assert probe.set_parameter("identifier", "set", ["J=1.0"]).successful
    assert probe.change("identifier", "configure")
    refused = probe.set_parameter("identifier", "set", ["J=2.0"])
    assert not refused.successful and "deactivate and clean up" in refused.reason
    assert probe.change("identifier", "activate")
    assert probe.state("identifier") == "active"
    samples = probe.source(JointSamples, "joint_samples")
    publish(samples, probe, [sample(k) for k in range(3 * RATE)])
    probe.until(lambda: latest(found), "an estimate")
    assert probe.change("identifier", "deactivate")
    assert probe.change("identifier", "cleanup")
    assert probe.set_parameter("identifier", "set", ["J=2.0"]).successful
    assert probe.change("identifier", "configure") and probe.change("identifier", "activate")
