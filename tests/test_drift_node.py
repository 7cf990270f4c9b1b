"""Baselines of the identifier: set by a service, kept in a file, and a warning as long as a parameter is away."""

import json

import numpy as np
import pytest
from robot_messages import NANO, stamp
from std_srvs.srv import Trigger

from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples
from joint_id_ros.qos import LATEST

RATE = 500
TRUTH = {"J": 2.0, "c": 8.0, "tau_f": 3.0, "tau_0": 0.7}
WORN = {**TRUTH, "c": 12.0, "tau_f": 4.5}
NOISE = {"link_position": 2e-5, "link_velocity": 1.5e-3, "torque": 0.05}
STRETCH_S, WINDOW_S, HOP_S = 6, 2.0, 0.5
KNOWN_S = 4.0  # after a change, in which its size is found
CONFIRM_S = 0.4  # less than a hop
BEGIN = 1000 * NANO


@pytest.fixture(scope="module")
def motion():
    """A joint whose friction grows by half after a stretch, and is as before after another."""
    rng, x0, parts = np.random.default_rng(2), None, []
    time = np.arange(STRETCH_S * RATE + 1) / RATE
    for k, values in enumerate((TRUTH, WORN, TRUTH)):
        torque = multisine(time, 60.0, (0.5, 1.0, 1.5, 2.5, 4.0, 6.0), seed=k)
        exact = simulate(build("rigid_joint"), time, {"torque": torque}, values, x0)
        x0 = {name: exact[name][-1] for name in ("link_position", "link_velocity")}
        parts.append({n: exact[n][:-1] + std * rng.standard_normal(len(time) - 1) for n, std in NOISE.items()})
    return {name: np.concatenate([part[name] for part in parts]) for name in NOISE}


@pytest.fixture
def publish(probe, motion):
    """Publish the samples of a stretch of the motion; each hop waits for the estimate of the one before.

    A drift is confirmed by estimates: a busy machine that got the stretch at once would make a single one of it.
    """

    def send(publisher, found, stretch, seconds=STRETCH_S):
        first = stretch * STRETCH_S * RATE
        for k in range(first, first + seconds * RATE):
            message = JointSamples(name=["elbow"], measured=JointSamples.LINK_POSITION | JointSamples.LINK_VELOCITY)
            message.measured |= JointSamples.TORQUE
            message.header.stamp = stamp(BEGIN + k * NANO // RATE)
            for name in NOISE:
                setattr(message, name, [motion[name][k]])
            publisher.publish(message)
            passed_s = (k + 1) / RATE
            if passed_s % HOP_S == 0.0 and passed_s > WINDOW_S + HOP_S:
                probe.until(lambda end_s=passed_s - 1.1 * HOP_S: end_of_newest(found) > end_s, "an estimate of the hop")

    return send


def end_of_newest(found) -> float:
    """End of the newest window in s after the first sample, whatever its estimate is."""
    joints = found[-1].joints if found else []
    return max((seconds(j.window_end) for j in joints), default=-1.0)


def newest(found, after_s=0.0) -> JointEstimate | None:
    """The newest good estimate, if its window ends so many seconds after the first sample."""
    joints = found[-1].joints if found else []
    good = [j for j in joints if j.status == JointEstimate.CONVERGED and seconds(j.window_end) > after_s]
    return good[0] if good else None


def seconds(instant) -> float:
    return instant.sec - BEGIN / NANO + instant.nanosec / NANO


def set_baseline(probe):
    return probe.call(Trigger, "/identifier/set_baseline", Trigger.Request())


def test_a_parameter_that_leaves_its_baseline_is_told_until_it_is_back(start, probe, publish, tmp_path):
    file = tmp_path / "baselines.json"
    options = {"baseline_file": str(file), "drift_confirm_s": CONFIRM_S}
    process = start("identifier", model="rigid_joint", actuation="torque", **options)
    found = probe.collect(JointParams, "joint_params", LATEST)
    samples = probe.source(JointSamples, "joint_samples")
    refused = set_baseline(probe)
    assert not refused.success and "no good estimate yet" in refused.message and not file.exists()

    publish(samples, found, 0)
    probe.until(lambda: newest(found, 2.0), "an estimate")
    done = set_baseline(probe)
    assert done.success and done.message == f"baseline of elbow: written to {file}"
    assert list(json.loads(file.read_text())["joints"]) == ["elbow"]

    publish(samples, found, 1)
    worn_s = STRETCH_S + KNOWN_S

    def drifted():
        return {drift.name: drift for drift in newest(found, worn_s).drifts} if newest(found, worn_s) else {}

    probe.until(lambda: {"c", "tau_f"} <= drifted().keys(), "a drift of both")
    drifts = drifted()
    for name, drift in drifts.items():
        if name in ("c", "tau_f"):
            assert drift.baseline == pytest.approx(TRUTH[name], rel=0.1)
            assert drift.value - drift.baseline == pytest.approx(0.5 * TRUTH[name], abs=5.0 * drift.std_dev)
            assert 0.999 < drift.confidence <= 1.0
            assert STRETCH_S - HOP_S < seconds(drift.since) < worn_s
    probe.until(lambda: probe.told("identifier", "above its baseline"), "a warning")
    warning = probe.told("identifier", "above its baseline")
    assert "elbow: c is" in warning.message
    assert warning.level >= b"\x01"  # an error, if this computer has too much to do as well
    assert {v.key: v.value for v in warning.values}["joints with a baseline"] == "elbow"

    publish(samples, found, 2)
    probe.until(lambda: newest(found, 2 * STRETCH_S + KNOWN_S) and not newest(found).drifts, "no drift any more")
    probe.diagnostics.clear()
    # When the samples have ended before, this is reported in place of "identified 1 joints".
    probe.until(lambda: probe.diagnostics and "baseline" not in probe.diagnostics[-1].message, "the end of the warning")
    assert "Traceback" not in process.text


def test_baselines_are_read_when_the_node_is_configured(start, probe, publish, tmp_path):
    file = tmp_path / "baselines.json"
    process = start("identifier", model="rigid_joint", actuation="torque", baseline_file=str(file), autostart=False)
    file.write_text("{}")
    assert not probe.change("identifier", "configure")
    probe.until(lambda: "baselines.json: no baselines" in process.text, "the reason")
    file.unlink()
    assert probe.change("identifier", "configure") and probe.change("identifier", "activate")
    found = probe.collect(JointParams, "joint_params", LATEST)
    samples = probe.source(JointSamples, "joint_samples")
    publish(samples, found, 0, 3)
    probe.until(lambda: newest(found, 2.0), "an estimate")
    assert set_baseline(probe).success
    for transition in ("deactivate", "cleanup"):
        assert probe.change("identifier", transition)
    # Another inertia is held now: what the baseline says of friction cannot be compared with it.
    assert probe.set_parameter("identifier", "fix", ["J=2.0"]).successful
    assert probe.change("identifier", "configure") and probe.change("identifier", "activate")
    assert "watching for drift from the baselines of elbow" in process.text
    publish(samples, found, 0, 3)
    text = "joint elbow: J was estimated in the baseline and is held now"
    probe.until(lambda: probe.told("identifier", text), "why nothing is compared")
    assert newest(found) is not None and not newest(found).drifts
