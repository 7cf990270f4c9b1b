"""Noise of the sensor of the drive, which moves nothing: what is learned online from many samples stays honest."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.emulator.arm import Arm
from joint_id_core.emulator.reference import TICK_S
from joint_id_core.emulator.robots import build_joints
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.innovations.input_noise import with_load
from joint_id_core.models import HarmonicDrive, build
from joint_id_core.online import OnlineIdentifier, input_noise
from joint_id_core.online.input_noise import InputNoise
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.simulation.excitation import Multisine
from joint_id_core.simulation.position_control import ControlledJoint, Reference
from joint_id_core.simulation.sensors import Sensors

from .moves import random_moves

SECONDS = 40
MEASURED = ("link_position", "motor_velocity", "current")
NOISE = {"link_position": 2e-5, "motor_velocity": 0.15, "current": 0.02}
INERTIAS = ("J_m", "J_q", "k_1")


@pytest.fixture(scope="module")
def motion():
    """Two joints under controllers that read the exact state, so that the current is exact and smooth."""
    joints = build_joints("ur3e")[3:5]
    arm, rows = Arm(joints, range(2), 0.3), []
    for _ in range(round(SECONDS / TICK_S)):
        arm.decide(arm.joints.link_position, arm.joints.motor_velocity)
        rows.append([arm.joints.link_position, arm.joints.motor_velocity, arm.current])
        arm.advance(go=True)
    return joints, np.array(rows)


def last_estimate(joint, course, seed):
    """What is known of a joint at the end, of signals (T, 3) with noise."""
    time = TICK_S * np.arange(len(course))
    shown = Sensors(noise=NOISE).measure(Recording(time, dict(zip(MEASURED, course.T, strict=True))), seed)
    identifier = OnlineIdentifier(HarmonicDrive(actuation="current"), ParameterSettings({"k_t": joint.values["k_t"]}))
    found = [identifier.update(shown.slice(k, k + 50)) for k in range(0, len(time), 50)]
    return [e for e in found if e is not None][-1]


@pytest.mark.long
def test_noise_in_the_recorded_current_biases_no_inertia_beyond_its_sigma(motion):
    joints, courses = motion
    off = []
    for seed in range(4):
        for i, joint in enumerate(joints):
            estimate = last_estimate(joint, courses[:, :, i], seed)
            assert estimate.converged
            rows = [estimate[name] for name in INERTIAS]
            off.append([(row.value - joint.values[row.name]) / row.std_dev for row in rows])
    assert np.max(np.abs(np.mean(off, axis=0))) < 1.5
    assert np.max(np.abs(off)) < 3.0


def test_a_bias_beyond_the_prior_is_none(monkeypatch):
    """On a wrist that others load it once was 10 Nm times 100, and the inertia e^-2000."""
    monkeypatch.setattr(input_noise, "attenuation", lambda *_: np.array([0.5, -1e4]))
    tracker: Any = SimpleNamespace(shown_noise={0: 1.0})
    piece: Any = SimpleNamespace(duration=0.0)
    noise = InputNoise(SummedEffect(np.array([2.0, 10.0])))
    noise.learn(tracker, [piece], 60.0)
    assert np.allclose(noise.bias(np.eye(2)), [0.5, -10.0])


RIGID, JOINT = build("rigid_joint"), {"J": 0.6, "c": 8.6, "tau_f": 12.0, "tau_0": -1.7}
HZ, TORQUE_NM, ENCODER_RAD = 250, 0.25, 1.2e-5
CHANGES_S, ENDS_S = 16.0, 30.0
LOADED = {**JOINT, "J": 1.5 * JOINT["J"]}


def estimates(
    load: float = 1.0, values: Mapping[str, float] = JOINT, reference: Reference | None = None,
    torque: float = TORQUE_NM, encoder: float = ENCODER_RAD,
) -> list[Estimate]:  # fmt: skip
    """Estimates while a joint moves from point to point, whose inertia becomes `load` times as large."""
    joint = ControlledJoint(RIGID, controller_of(RIGID, values), reference or random_moves(3), values)
    rows: list[dict[str, float]] = []
    for k in range(round(ENDS_S * HZ)):
        if k == round(CHANGES_S * HZ):
            joint.change({**values, "J": load * values["J"]})
        rows.append({**joint.shown, **joint.tick(1.0 / HZ)})
    rng, seen = np.random.default_rng(0), {n: np.array([row[n] for row in rows]) for n in ("link_position", "torque")}
    channels = {
        "link_position": encoder * np.round(seen["link_position"] / encoder),
        "torque": seen["torque"] + torque * rng.standard_normal(len(rows)),
    }
    recording = Recording(np.arange(len(rows)) / HZ, channels, source="moves")
    identifier = OnlineIdentifier(RIGID)
    found = [identifier.update(recording.slice(k, k + 25)) for k in range(0, len(rows), 25)]
    return [estimate for estimate in found if estimate is not None]


def errors(estimate: Estimate, truth: dict[str, float]) -> list[float]:
    """Errors over standard deviations of what is estimated."""
    rows = [estimate[name] for name in truth if estimate[name].verdict is Verdict.ESTIMATED]
    return [abs(row.value - truth[row.name]) / row.std_dev for row in rows]


def test_noise_of_the_torque_sensor_is_no_change_of_the_joint():
    """Slow moves after fast ones looked like another inertia: 13 of 33 estimates were converged."""
    moving = [estimate for estimate in estimates(load=1.0) if estimate.status is not Status.NO_MOTION]
    later = moving[len(moving) // 4 :]
    assert len(later) > 20 and all(estimate.converged for estimate in later)
    assert max(max(errors(estimate, JOINT)) for estimate in later) < 4.0


def test_beside_such_noise_a_load_is_still_seen():
    found = estimates(load=1.5)
    before, after = ([e for e in found if (e.end > CHANGES_S) == late] for late in (False, True))
    wrong = [
        e for es, true in ((before, JOINT), (after, LOADED)) for e in es if e.converged and max(errors(e, true)) > 4.0
    ]
    assert len(wrong) <= 2, "a second, at the change"
    assert any("J from" in e.message for e in after)
    last = [e["J"] for e in after if e.converged][-1]
    assert abs(last.value - LOADED["J"]) < 4.0 * last.std_dev < 0.05 * LOADED["J"]


@pytest.mark.long
def test_noise_that_the_filter_takes_for_that_of_the_load_counts_as_well():
    """A rigid joint hides which of the two it is: `J` was 3.8 % too large, 5 standard deviations, or seen to change."""
    small = {"J": 3e-4, "c": 6.2e-3, "tau_f": 1.02e-2, "tau_0": 1.7e-3}
    waves = Multisine((0.25, 0.2, 0.15, 0.1), (0.31, 0.53, 0.83, 1.31), (0.0, 1.0, 4.0, 2.0))
    usable = (Status.CONVERGED, Status.DISAGREE)  # the noise of the torque makes `c` of the second opinion too large
    found = [e for e in estimates(1.0, small, waves, torque=1.2e-3, encoder=9.6e-5) if e.status in usable]
    assert len(found) > 50 and max(max(errors(estimate, small)) for estimate in found) < 3.0


def test_the_noise_of_the_load_is_that_of_a_rigid_drive_through_its_gear():
    of_inputs = np.array([4.0, 900.0])  # drive, load
    rigid = build("rigid_joint", actuation="current")
    values = np.array(list(rigid.values({"N": 100.0, "k_t": 0.1}).values()))
    assert with_load(rigid, values, of_inputs).tolist() == [4.0 + 900.0 / 10.0**2, 900.0]
    flexible = build("harmonic_drive")
    assert with_load(flexible, np.array(list(flexible.values().values())), of_inputs).tolist() == [4.0, 900.0]
