"""A link that goes nowhere shows nothing of the friction with which it would slide."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Regression, fit
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.standing import standing
from joint_id_core.estimators.shared.stillness import held_still
from joint_id_core.models import LAWS, build
from joint_id_core.results.estimate import Verdict
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

HELD = 2e4  # Nm s/rad: the link yields by 0.1 mrad to the torque of the gear
SENSORS = {"link_position": 2e-5, "motor_velocity": 1e-2}


def recorded(model, torque, values, **sensors):
    """Eight seconds of a joint under four waves of `torque` in Nm, with noise of torque and sensors."""
    rng, time = np.random.default_rng(0), np.arange(2000) / 250
    waves = zip((0.4, 1.3, 2.9, 5.1), rng.uniform(0.0, 6.28, 4), strict=True)
    drive = torque * sum(np.sin(2.0 * np.pi * f * time + phase) for f, phase in waves)
    moved = simulate(model, time, {"torque": drive + 0.2 * torque * rng.standard_normal(len(time))}, values)
    seen = {name: moved[name] + sigma * rng.standard_normal(len(time)) for name, sigma in sensors.items()}
    return Recording(time, {**seen, "torque": drive})


def held():
    return recorded(build("harmonic_drive"), 0.015, {"tau_fq": 0.0, "c_q": HELD, "tau_fm": 0.004}, **SENSORS)


@pytest.mark.long
def test_stiction_of_a_link_that_is_held_is_not_told_as_its_friction():
    """It was `converged` with tau_fq 6.7 ± 0.15 Nm, where nothing slides and tau_fq is 0; so it was on a UR3e."""
    found = fit(build("harmonic_drive"), held())
    assert found.converged, found.message
    rows = {p.name: p for p in found.parameters}
    assert rows["tau_fq"].verdict == rows["c_q"].verdict == Verdict.NOT_EXCITED
    said = "The link goes nowhere and shows no sliding friction (c_q, tau_fq)"
    assert any(note.startswith(said) for note in found.notes)
    assert rows["k_1"].verdict is Verdict.ESTIMATED and abs(rows["k_1"].value - 5164.0) < 4.0 * rows["k_1"].std_dev


def test_nor_is_it_by_a_regression():
    """It was `converged` with c 1980 ± 10 Nm s/rad."""
    recording = recorded(build("rigid_joint"), 1.0, {"J": 1.0, "c": 0.1 * HELD, "tau_f": 0.0}, link_position=2e-5)
    found = fit(build("rigid_joint"), recording, estimator=Regression())
    assert "The link goes nowhere" in found.message
    verdicts = {p.name: p.verdict for p in found.parameters}
    assert verdicts["c"] == verdicts["tau_f"] == Verdict.NOT_EXCITED


@pytest.mark.long
@pytest.mark.parametrize("law", first_quick(LAWS))
def test_friction_of_the_link_is_found_in_a_model(law):
    recording = held()
    of_law = {"coulomb_viscous": [], "stribeck": ["dtau_sq", "w_bq"], "eyring": ["w_eq"]}[law]
    assert standing(prepare(build("harmonic_drive", friction=law), recording)) == ("c_q", "tau_fq", *of_law)
    away = recording.with_channels({"link_position": recording["link_position"] + 1e-2 * recording.time})
    assert standing(prepare(build("harmonic_drive", friction=law), away)) == ()
    of_motor = recording.with_channels({"link_velocity": np.gradient(recording["link_position"], 0.004)})
    assert standing(prepare(build("motor_side"), of_motor)) == ()


def test_a_joint_that_moves_is_not_taken_for_one_that_is_held_because_its_encoder_is_noisy():
    moves = recorded(build("rigid_joint"), 1.0, {"J": 1.0, "c": 10.0, "tau_f": 0.3}, link_position=1e-3)
    assert held_still(moves) and np.ptp(moves["link_position"]) > 0.02
    assert standing(prepare(build("rigid_joint"), moves)) == ()
