"""A public UR3e log, replayed from a bag through player, filter and identifier."""

import signal
from pathlib import Path

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.formats import write_bag
from joint_id_core.models import build
from joint_id_msgs.msg import JointEstimate, JointParams
from joint_id_ros.qos import LATEST

ROOT = Path(__file__).resolve().parent.parent
LOG = ROOT.parent / "shared/data/ur3e/wave_currentData_100v_40a.csv"
CONFIG = ROOT / "config/ur3e_replay.yaml"
RATIO = 101.0
WINDOW_S = 25.0
JOINTS = {1: "shoulder", 2: "elbow", 3: "wrist_1"}
VALUES = {"N": RATIO, "k_t": 0.0802, "J_m": 2e-4}

pytestmark = pytest.mark.skipif(not LOG.exists(), reason=f"public UR3e log not at {LOG}")


def recording(log, k):
    """What the controller reports of joint `k`, gaps included."""
    channels = {
        "link_position": log[f"actual_q_{k}"],
        "motor_velocity": RATIO * log[f"actual_qd_{k}"],
        "current": log[f"actual_current_{k}"],
    }
    return Recording(log["timestamp"], channels)


@pytest.fixture(scope="module")
def log():
    return np.genfromtxt(LOG, names=True)


@pytest.fixture(scope="module")
def bags(log, tmp_path_factory):
    """The two halves of the log as bags of three joints, each a little longer than a window."""
    joints, folder = {name: recording(log, k) for k, name in JOINTS.items()}, tmp_path_factory.mktemp("ur3e")
    begin, end = (next(iter(joints.values())).time[k] for k in (0, -1))
    spans = {"first": (begin, begin + WINDOW_S + 1.0), "second": (end - WINDOW_S - 1.0, end)}
    for half, span in spans.items():
        write_bag(folder / half, {name: joint.window(*span) for name, joint in joints.items()})
    return [folder / half for half in spans]


def stiffness(estimate):
    """Value and standard deviation of k_1 in Nm/rad."""
    p = next(p for p in estimate.parameters if p.name == "k_1")
    return p.value, p.std_dev


def two_windows(start, probe, bags, joints, **parameters):
    """By joint, its estimates of the two halves of the log, each by a filter and an identifier of its own."""
    windows = {"window_s": WINDOW_S, "hop_s": WINDOW_S, "memory_s": 0.0}
    found = {joint: [] for joint in joints}
    for bag in bags:
        published = probe.collect(JointParams, "joint_params", LATEST)
        nodes = [start("identifier", "--params-file", str(CONFIG), joints=joints, **windows, **parameters)]
        nodes.append(start("filter", "--params-file", str(CONFIG)))
        probe.until(lambda: probe.count_subscribers("joint_samples") == 1, "the identifier")
        nodes.append(start("player", "--params-file", str(CONFIG), bag=bag, rate=5.0))

        def newest(published=published):
            return {j.joint: j for m in published for j in m.joints}

        probe.until(lambda newest=newest: len(newest()) == len(joints), f"estimates of {bag.name}")
        assert nodes.pop().wait() == 0
        for joint, estimate in newest().items():
            found[joint].append(estimate)
        for node in nodes:
            node.signal(signal.SIGINT)
            assert node.wait() == 0
        probe.until(lambda: probe.count_subscribers("joint_samples") == 0, "the end of the identifier")
    return found


@pytest.mark.long
def test_the_stiffness_of_every_joint_is_repeatable_or_published_as_bad(start, probe, bags):
    """The two halves of the log, each by itself. The elbow, which is held still, must be found in both."""
    values = [*(f"{name}={value}" for name, value in VALUES.items()), "shoulder.k_t=0.1"]
    estimates = two_windows(start, probe, bags, list(JOINTS.values()), set=values)
    for joint, (first, second) in estimates.items():
        print(joint, [(e.status, e.message, stiffness(e)) for e in (first, second)])
        assert first.window_end.sec <= second.window_start.sec
        if first.status == second.status == JointEstimate.CONVERGED:
            (a, std_a), (b, std_b) = stiffness(first), stiffness(second)
            assert abs(a - b) < 3.0 * np.hypot(std_a, std_b)
        else:
            assert all(e.message for e in (first, second))
    first, second = estimates["elbow"]
    assert first.status == second.status == JointEstimate.CONVERGED
    (a, std_a), (b, std_b) = stiffness(first), stiffness(second)
    assert abs(a - b) < 1.96 * np.hypot(std_a, std_b)
    for value, std in ((a, std_a), (b, std_b)):
        assert 4.2e3 - 2 * std < value < 4.5e3 + 2 * std  # a prototype found 4467 +- 75 and 4247 +- 85
        assert std < 0.25 * value  # most of it what the model lacks, which the message names


@pytest.mark.long
def test_rounding_does_not_decide_what_is_found_of_a_joint_that_stands(log):
    """Machines round differently. Where the model lacks something every fit once ended at another point."""
    elbow, rng = recording(log, 2), np.random.default_rng(0)
    second = elbow.window(elbow.time[0] + 27.9, np.inf)
    found = []
    for _ in range(2):
        rounded = {name: x * (1.0 + 1e-14 * rng.standard_normal(len(x))) for name, x in second.channels.items()}
        estimate = fit(
            build("motor_side", actuation="current"),
            Recording(second.time, rounded),
            ParameterSettings({**VALUES, "k_2": 0.0}, fixed=["k_2"], priors={"J_m": 0.5}),
        )
        assert estimate.converged, estimate.message
        found.append(next(p for p in estimate.parameters if p.name == "k_1"))
    one, other = found
    assert abs(one.value - other.value) < 0.5 * min(one.std_dev, other.std_dev)  # of 50 such fits all were within 0.4


@pytest.mark.long
def test_the_shoulder_as_a_rigid_joint_shows_its_gravity_and_friction(start, probe, bags):
    """Much hangs on where the window begins, and the intervals say so.

    The joint rests in the first nine seconds. That tells gravity only up to the friction that holds it, so this rest is
    left out. Inertia and gravity are then hard to tell apart, and gravity is known to 7 to 50 %.
    """
    options = {"model": "rigid_joint", "gravity": True, "set": ["N=101", "k_t=0.1"], "fix": [""], "priors": ""}
    first, second = two_windows(start, probe, bags, ["shoulder"], **options)["shoulder"]
    for estimate in (first, second):
        found = {p.name: p for p in estimate.parameters}
        print(estimate.status, estimate.message, {name: (p.value, p.std_dev) for name, p in found.items()})
        for value, p, expected in (
            (abs(found["a_g"].value), found["a_g"], 16.0),
            (found["tau_f"].value, found["tau_f"], 4.5),
        ):
            assert abs(value - expected) < max(2.0 * p.std_dev, 0.15 * expected)
        assert found["tau_f"].std_dev < 0.3 * 4.5


UR10E = ROOT.parent / "shared/data/ur10e/ur-20_02_12-40sec_12harm.csv"
ARM = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
PER_AMPERE = (11.8, 12.0, 9.8, 10.7, 10.6, 10.7)  # Nm at the link: config/ur10e.yaml times the gear ratio


@pytest.mark.long
def test_an_arm_at_100_hz_is_published_from_the_first_samples_and_its_lift_is_not_called_known(start, probe, tmp_path):
    """The usual cutoff of 50 Hz is half of the rate. J of the lift is 17.5 kg m2; others move it: 33 to 125 before."""
    log = np.genfromtxt(UR10E, delimiter=",")
    log = log[np.concatenate([[True], np.diff(log[:, 0]) > 0.0])]  # some stamps repeat
    bag = tmp_path / "arm"
    joints = {
        name: Recording(log[:, 0], {"link_position": log[:, 1 + k], "torque": gain * log[:, 13 + k]})
        for k, (name, gain) in enumerate(zip(ARM, PER_AMPERE, strict=True))
    }
    write_bag(bag, joints)
    published = probe.collect(JointParams, "joint_params", LATEST)
    settings = {"model": "rigid_joint", "gravity": True, "window_s": 5.0, "hop_s": 1.0}
    nodes = [start("identifier", **settings), start("filter")]
    probe.until(lambda: probe.count_subscribers("joint_samples") == 1, "the identifier")
    player = start("player", bag=bag, rate=4.0)
    probe.until(lambda: not player.running, "the end of the bag")
    assert player.wait() == 0

    def found(joint):
        """One estimate a window: a message holds the newest ones of all joints."""
        windows = {}
        for estimate in (j for m in published for j in m.joints if j.joint == joint):
            windows.setdefault((estimate.window_end.sec, estimate.window_end.nanosec), estimate)
        return list(windows.values())

    # On a busy machine, several hops may come as one.
    probe.until(lambda: all(len(found(name)) > 3 for name in ARM), "estimates of six joints")
    begin = log[0, 0]
    for name in ARM:
        windows = [j for j in found(name) if j.samples > 0]
        assert min(j.window_start.sec + 1e-9 * j.window_start.nanosec for j in windows) < begin + 7.0
    known = [j for j in found("lift") if j.status == JointEstimate.CONVERGED]
    assert len(known) < 0.3 * len(found("lift"))
    for node in nodes:
        node.signal(signal.SIGINT)
        assert node.wait() == 0
