"""Noise of the sensor of the drive, which moves nothing: what is learned online from many samples stays honest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.emulator.arm import Arm
from joint_id_core.emulator.reference import TICK_S
from joint_id_core.emulator.robots import build_joints
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import HarmonicDrive
from joint_id_core.online import OnlineIdentifier, input_noise
from joint_id_core.online.input_noise import InputNoise
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.simulation.sensors import Sensors

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
        arm.decide()
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


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 4), marks=pytest.mark.long)], ids=["one", "more"])
def test_noise_in_the_recorded_current_biases_no_inertia_beyond_its_sigma(motion, seeds):
    joints, courses = motion
    off = []
    for seed in seeds:
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
