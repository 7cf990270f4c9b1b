"""What the identifier knows outlives its process: kill -9, restart, and the services that save, load and reset it."""

import signal
import time

import numpy as np
import pytest
from known_joint import (
    BEGIN,
    RATE,
    TRUTH,
    Samples,
    assert_lost_little,
    assert_restored,
    assert_right,
    instant,
    std_devs,
    widened,
)
from robot_messages import NANO
from std_srvs.srv import Trigger

from joint_id_core.results.estimate import Status
from joint_id_core.stored.state_file import StateFile
from joint_id_msgs.msg import JointEstimate


@pytest.fixture
def joint(probe, start, tmp_path):
    """A joint in motion; its identifier keeps what it knows in a file."""
    return Samples(probe, start, tmp_path / "state.json")


@pytest.mark.parametrize("times", [1, pytest.param(3, marks=pytest.mark.long)])
def test_kill_9_costs_at_most_two_seconds_of_knowledge(joint, times):
    rng = np.random.default_rng()
    joint.begin()
    joint.identify()
    for _ in range(times):
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
