"""Recordings of ordinary work, from point to point with rests: what a joint does while it sticks is not believed."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.results.estimate import Verdict
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .moves import repeated_moves
from .quick import first_quick

SENSORS = Sensors(noise={"link_position": 1e-5, "motor_velocity": 0.1})
KNOWN = {"rigid_joint": {"N": 101.0}, "harmonic_drive": {"N": 101.0}}
TRUE = {"rigid_joint": {"J": 1.4, "c": 2.8, "tau_f": 4.6}, "harmonic_drive": {"J_q": 0.9, "tau_fq": 2.0}}


def working(name: str, places: tuple[float, ...], seconds: float, seed: int, rest_s: float = 0.7) -> Recording:
    """A joint with exact stick and slip under position control; the controller sees the sensors."""
    model, time = build(name), np.arange(round(500 * seconds)) / 500
    values = KNOWN[name] | TRUE[name]
    seen = simulate_closed_loop(
        model,
        PositionController(),
        repeated_moves(places, 0.8, rest_s),
        time,
        values,
        torque_noise=0.003,
        seed=seed,
        sensors=SENSORS,
    )
    measured = [n for n in SENSORS.noise if n in model.state_names]
    return Recording(time, {n: seen[n] for n in (*measured, "torque")})


@pytest.mark.parametrize("name", first_quick(list(KNOWN)))
@pytest.mark.parametrize("seed", first_quick(range(2)))
def test_friction_and_inertia_of_a_joint_that_rests_half_the_time_are_right(name, seed):
    recording = working(name, (0.0, 0.8, -0.3, 0.4), 9.0, seed)
    assert prepare(build(name), recording, leave_out_rests=True).rest.mean() > 0.25
    found = fit(build(name), recording, ParameterSettings(KNOWN[name]))
    assert found.converged
    truth = build(name).values(TRUE[name])
    for p in found.parameters:
        if p.name in found.free:
            assert p.verdict is Verdict.ESTIMATED, p
            assert abs(p.value - truth[p.name]) < 5.0 * p.std_dev, p
    friction = [found[n] for n in ("tau_f", "c", "tau_fq", "c_q") if n in found.free]
    assert all(p.std_dev < 0.1 * p.value for p in friction), friction
    # Plain Coulomb friction: nothing asks for another law, or for a load that is not there.
    assert not any("try --" in text for text in found.checks.texts), found.checks.texts


@pytest.mark.parametrize("name", first_quick(list(KNOWN)))
def test_a_joint_that_rests_nine_tenths_of_the_time_gives_right_values(name):
    """Its rests were taken for motion that noise hides: `converged` with a stiffness wrong by 142 deviations."""
    recording = working(name, (0.0, 0.8, -0.3, 0.4), 32.0, seed=1, rest_s=7.2)
    assert 0.88 < prepare(build(name), recording, leave_out_rests=True).rest.mean() < 0.93
    found = fit(build(name), recording, ParameterSettings(KNOWN[name]))
    assert found.converged
    truth = build(name).values(TRUE[name])
    for p in found.parameters:
        if p.name in found.free:
            assert abs(p.value - truth[p.name]) < 5.0 * p.std_dev, p
            assert p.name == "tau_0" or p.std_dev < 0.2 * p.value, p


@pytest.mark.parametrize("name", list(KNOWN))
def test_what_one_direction_with_rests_cannot_tell_is_not_told(name):
    """One move in one direction and rests: Coulomb friction and an offset look alike. Rests seemed to tell them."""
    found = fit(build(name), working(name, (0.0, 0.9), 1.4, 0), ParameterSettings(KNOWN[name]))
    truth = build(name).values(TRUE[name])
    told = [p for p in found.parameters if p.verdict is Verdict.ESTIMATED and found.converged]
    assert all(abs(p.value - truth[p.name]) < 5.0 * p.std_dev for p in told), told


def test_a_joint_that_is_held_and_shaken_by_others_keeps_its_samples():
    """The twist of its gear is all that it shows, and the motor rests between two shakes."""
    time = np.arange(1000) / 250
    shake = np.sin(2.0 * np.pi * 3.0 * time) * (np.sin(np.pi * time) > 0.3)
    rng = np.random.default_rng(0)
    recording = Recording(
        time,
        {
            "link_position": 0.3 + 5e-5 * shake + 2e-5 * rng.standard_normal(len(time)),
            "motor_velocity": 0.3 * shake + 1e-3 * rng.standard_normal(len(time)),
            "torque": 1e-3 * shake,
        },
    )
    assert not prepare(build("motor_side"), recording, leave_out_rests=True).rest.any()
    away = recording.with_channels({"link_position": recording["link_position"] + 0.2 * shake})
    assert prepare(build("motor_side"), away, leave_out_rests=True).rest.mean() > 0.3
