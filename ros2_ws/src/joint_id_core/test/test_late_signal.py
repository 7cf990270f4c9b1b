"""Signals of joints with a voltage that are late: the fit says which one, and by how much."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

DC, WHOLE = build("dc_motor"), build("electromechanical")
SEEN = {"current": 0.05, "motor_velocity": 0.1}  # noise of the sensors


def later(recording: Recording, name: str, seconds: float) -> Recording:
    return recording.with_channels({name: np.interp(recording.time - seconds, recording.time, recording[name])})


@pytest.fixture(scope="module")
def whole() -> Recording:
    return simulate_motion(WHOLE, 2.0, values={"k_1": 6500.0, "R": 0.6})


@pytest.mark.long
def test_a_late_encoder_of_the_link_is_no_damping_of_the_gear(whole):
    """The fit converges with four times the damping of the gear; only the likelihood tells."""
    found = fit(WHOLE, later(whole, "link_position", 0.004))
    assert found.status is Status.POOR_FIT
    assert found.message.startswith("Link_position is about 4 ms (2 samples) late against the other signals")
    assert found["c_1"].value > 2.0 * WHOLE.values()["c_1"]


def test_a_good_recording_of_a_whole_joint_has_no_late_signal(whole):
    found = fit(WHOLE, whole)
    assert found.converged and "against the other signals" not in found.message


@pytest.mark.parametrize(
    ("name", "late", "said"),
    first_quick(
        [
            ("voltage", 0.004, "Voltage is about 4 ms (2 samples) late"),
            ("voltage", -0.006, "Voltage is about 6 ms (3 samples) early"),
            ("current", 0.004, "Current is about 4 ms (2 samples) late"),
            ("motor_velocity", -0.002, "Motor_velocity is about 2 ms (1 sample) early"),
        ],
        2,
    ),
)
def test_a_late_signal_of_a_motor_is_named(name, late, said):
    found = fit(DC, later(simulate_motion(DC, 3.0, values={"R": 0.6}), name, late))
    assert found.status is Status.POOR_FIT and found.message.startswith(said), found.message


@pytest.mark.parametrize("friction", first_quick(["stribeck", "coulomb_viscous", "eyring"]))
@pytest.mark.parametrize("rate", [200.0, pytest.param(1000.0, marks=pytest.mark.long)])
def test_friction_of_another_law_is_no_late_signal(friction, rate):
    for seed in (1, 2):
        found = fit(DC, simulate_motion(build("dc_motor", friction=friction), 3.0, rate, seed=seed))
        assert "against the other signals" not in found.message


def behind_an_amplifier(tau_s: float, seed: int) -> Recording:
    """A motor whose amplifier passes the voltage through a filter of first order: 10 steps of it a sample."""
    rng, many, rate = np.random.default_rng(seed), 10, 1000.0
    time = np.arange(4000) / rate
    volts = multisine(time, 12.0, (0.5, 1.5, 2.5, 4.0), seed=seed + 1)
    pushed = volts + 0.03 * rng.standard_normal(len(volts))
    held = np.repeat(pushed, many)
    kept = np.exp(-1.0 / (rate * many * tau_s)) if tau_s else 0.0
    acts = lfilter([1.0 - kept], [1.0, -kept], held)
    fine = simulate(DC, np.arange(len(held)) / (rate * many), {"voltage": acts}, {"R": 0.6})
    channels = {name: fine[name][::many] + sigma * rng.standard_normal(len(time)) for name, sigma in SEEN.items()}
    return Recording(time, {**channels, "voltage": volts})


@pytest.mark.long
@pytest.mark.parametrize("seed", first_quick([1, 2]))
@pytest.mark.parametrize("tau_s", first_quick([2e-4, 4e-4]))
def test_a_voltage_that_acts_a_part_of_a_sample_later_is_named_and_in_the_intervals(tau_s, seed):
    """R was 1.5 % too large by 21 to 25 standard deviations, without a word."""
    found = fit(DC, behind_an_amplifier(tau_s, seed))
    assert "of a sample after its record" in found.message
    for name, value in {**DC.values(), "R": 0.6}.items():
        if name in found.free:
            assert abs(found[name].value - value) < 4.0 * found[name].std_dev, name
    assert "after its record" not in fit(DC, behind_an_amplifier(0.0, seed)).message
