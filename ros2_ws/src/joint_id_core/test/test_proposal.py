"""Which model is proposed to a user who names none: gravity only where the motion shows it as such."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.comparison.proposal import proposals
from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate


def moved(amplitude: float) -> Recording:
    """A joint with gravity under a torque of this amplitude in Nm, around which its load holds it."""
    model, time = build("rigid_joint", gravity=True), np.arange(4000) / 250.0
    truth = {"J": 1.0, "c": 3.0, "tau_f": 0.5, "tau_0": 0.0, "a_g": 0.0, "b_g": 20.0}
    torque = multisine(time, amplitude, (0.25, 0.6, 1.1), seed=2)
    motion = simulate(model, time, {"torque": torque}, truth)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(time))
    return Recording(time, {"link_position": motion["link_position"] + noise, "torque": torque})


@pytest.mark.parametrize(("amplitude", "gravity"), [(12.0, True), (1.5, False)], ids=["a turn", "a tenth of it"])
def test_over_a_small_travel_gravity_looks_like_any_spring(amplitude, gravity, monkeypatch):
    recording = moved(amplitude)
    assert proposals(recording, {})[0].options.gravity is gravity
    assert proposals(recording, {"gravity": True})[0].options.gravity
    monkeypatch.setattr("joint_id_core.comparison.gravity.TRAVEL", 0.0)
    assert proposals(recording, {})[0].options.gravity, "it would be taken, as both predict well with it"
