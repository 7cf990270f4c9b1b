"""A flexible joint of which one side is measured: whether this shows the gear."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Status
from joint_id_core.results.verdict import Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .online_motion import batches, motion

MODEL = build("harmonic_drive")


def moved(frequencies: tuple[float, ...], kept: str = "link_position") -> Recording:
    """A flexible joint of which one channel is measured."""
    time = np.arange(0.0, 10.0, 0.002)
    torque = multisine(time, 0.4, frequencies, seed=1)
    noisy = torque + 0.003 * np.random.default_rng(1).standard_normal(len(time))
    run = simulate(MODEL, time, {"torque": noisy, "external_torque": np.zeros_like(time)})
    seen = Sensors(noise={"link_position": 1e-5, "motor_position": 1e-3}).measure(run, 1, keep=(kept,))
    return seen.with_channels({"torque": torque})


def test_a_motion_that_shows_the_gear_is_fitted():
    found = fit(MODEL, moved((2.0, 5.0, 9.0, 14.0)))
    assert found.converged and found["k_1"].verdict is Verdict.ESTIMATED
    assert abs(found["k_1"].value - 5164.0) < 4.0 * found["k_1"].std_dev < 500.0


@pytest.mark.parametrize("ratio", [1.0, 101.0])
def test_a_rigid_joint_is_not_given_a_stiffness(ratio):
    found = fit(MODEL, motion(10.0), ParameterSettings({"N": ratio}))
    assert found.status is Status.MISSING_SIGNAL and found["k_1"].verdict is Verdict.NOT_EXCITED
    assert "does not show that the gear is flexible" in found.message
    assert "Record motor_position or motor_velocity, use model rigid_joint, or hold k_1 (--fix)" in found.message


def test_of_the_motor_alone_it_is_the_same():
    rigid = motion(10.0)
    motor = Recording(rigid.time, {"motor_position": 101.0 * rigid["link_position"], "torque": rigid["torque"] / 101.0})
    found = fit(MODEL, motor)
    assert found.status is Status.MISSING_SIGNAL and "Record link_position or link_velocity" in found.message


@pytest.mark.long
def test_a_stiffness_that_is_held_or_believed_is_not_asked_for():
    quick = motion(2.0)
    for settings in (ParameterSettings({"k_1": 1e5}, ("k_1",)), ParameterSettings(priors={"k_1": 0.1})):
        assert fit(MODEL, quick, settings).status is not Status.MISSING_SIGNAL


def test_without_a_torque_that_is_what_is_missing():
    still = motion(2.0)
    found = fit(MODEL, Recording(still.time, {"link_position": still["link_position"]}))
    assert found.status is Status.MISSING_SIGNAL and "torque" in found.message and "flexible" not in found.message


def test_online_it_is_said_as_well():
    joint = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=2.0, hop_s=0.5))
    found = [e for samples in batches(motion(4.0)) if (e := joint.update(samples)) is not None]
    assert found[-1].status is Status.MISSING_SIGNAL and "flexible" in found[-1].message
