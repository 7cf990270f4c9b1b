"""The motor side of a gear: the recorded motion of the link is an input, and its noise must not pass for physics."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.design.fourier import FourierMotion
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate
from joint_id_core.simulation.sensors import ur_robot_sensors

from .emulated_elbow import AT_HOME, GAINS, TRUTH, along, in_moves
from .quick import first_quick

MODEL = build("motor_side", actuation="current")
SETTINGS = ParameterSettings(GAINS, fixed=tuple(GAINS))


def require_true(found: Estimate) -> None:
    """Require a fit that converged, and every value within four standard deviations."""
    assert found.converged, found.message
    for name in found.free:
        assert abs(found[name].value - TRUTH.get(name, 0.0)) < 4.0 * found[name].std_dev, name


def test_noise_of_a_recorded_motion_is_no_other_value():
    """Slow strokes; by slow parts of the motion values were 6.8 sigma away, as the noise was in both."""
    tones = (0.6667, 0.8333, 1.1667, 1.3333, 2.1667)
    waves = np.full((1, 5), 0.01) / np.sqrt(tones)  # rad
    motion = FourierMotion(("elbow_joint",), (AT_HOME,), waves, waves, tones, 6.0, 1.0).sampled(125.0)
    found = fit(MODEL, along(motion, 9.0), SETTINGS)
    require_true(found)
    assert "other values than fast ones" not in " ".join([found.message, *found.notes])


@pytest.mark.parametrize("seed", first_quick([0, 1, 3, 5]))
def test_a_recorded_position_has_no_more_noise_than_it_shows(seed):
    """Six strokes; with twice as much J_m was 1.4 times too large, and c_m 4 to 6 sigma off."""
    found = fit(MODEL, along(in_moves([1.3, AT_HOME] * 6, 0.6), 8.2, seed), SETTINGS)
    require_true(found)
    assert found.noise["input link_position"] < 1.25 * ur_robot_sensors(TRUTH["N"]).noise["link_position"]
