"""Inputs that are derived from a position: as wide as the noise of the encoder allows."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.estimators.shared.derived_inputs import with_inputs
from joint_id_core.models import build
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .gear_with_play import CALM

MODEL, TRUTH = build("motor_side"), build("harmonic_drive").values()


def recorded(noise: float, seed: int) -> Recording:
    """Four seconds of Model 2 in calm motion, with the signals of a UR robot and an encoder with this noise in rad."""
    sensors = Sensors(noise={"link_position": noise, "motor_velocity": 0.05})
    moved = simulate_closed_loop(
        build("harmonic_drive"), PositionController(), CALM, np.arange(2000) / 500, torque_noise=0.003, seed=seed,
        sensors=sensors,
    )  # fmt: skip
    return Recording(moved.time, {n: moved[n] for n in ("link_position", "motor_velocity", "torque")})


@pytest.mark.parametrize("noise", [1e-7, 1e-6, 1e-5, 1e-4])
def test_the_noise_of_a_derived_velocity_stays_small_or_that_of_the_usual_filter(noise):
    rng, time = np.random.default_rng(0), np.arange(4000) / 500
    angle = 0.5 * np.sin(1.3 * time)
    shown = Recording(time, {"link_position": angle + noise * rng.standard_normal(len(time)), "torque": angle})
    found = with_inputs(MODEL, shown)["link_velocity"][100:-100]
    true = 0.65 * np.cos(1.3 * time)[100:-100]
    share = float(np.std(found - true) / np.std(true))
    usual = 200.0 * noise  # a low-pass of 50 Hz leaves 81 rad/s times the noise of the angle, over 0.46 rad/s
    assert share < max(1.5e-3, usual)


@pytest.mark.long
def test_a_velocity_of_a_precise_encoder_tells_nothing_of_later_disturbances():
    """With the usual low-pass of 50 Hz, J_m was 2.6 and c_1 2.2 standard deviations off (rms): it looks ahead."""
    off = []
    for seed in range(8):
        found = fit(MODEL, recorded(1e-6, 100 + seed))
        off.append([(found[n].value - TRUTH[n]) / found[n].std_dev for n in ("J_m", "c_1")])
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < 1.9).all()
