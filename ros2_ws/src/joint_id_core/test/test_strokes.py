"""Motions of which no promise can be kept: those that go there and back within little."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Array
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.joint import foretell
from joint_id_core.design.strokes import small_strokes
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build

RATE = 250.0
SAYS = "goes there and back within 0.01 rad"


@pytest.mark.parametrize(("amplitude", "share"), [(0.006, 0.0), (0.004, 1.0)])
def test_the_strokes_of_a_sine_are_twice_its_amplitude(amplitude, share):
    time = np.arange(1000) / RATE
    position, velocity = amplitude * np.cos(20.0 * time), -20.0 * amplitude * np.sin(20.0 * time)
    whole = slice(0, round(RATE * 6 * np.pi / 20.0))  # begins and ends with a stroke
    assert small_strokes(position[whole], velocity[whole]) == pytest.approx(share, abs=0.01)


def test_a_motion_in_one_direction_and_a_joint_that_stands_have_none():
    time = np.arange(1000) / RATE
    assert small_strokes(0.1 * time, np.full(1000, 0.1)) == 0.0
    assert small_strokes(np.zeros(1000), np.zeros(1000)) == 0.0


def tone(amplitude: float, frequency: float) -> Trajectory:
    return FourierMotion(("elbow_joint",), [0.0], [[amplitude]], [[0.0]], [frequency], 4.0, 1.0).sampled(RATE)


@pytest.mark.parametrize(("second", "told"), [(tone(0.1, 2.0), False), (tone(0.003, 4.0), True)])
def test_a_promise_that_may_not_be_kept_says_so(second, told):
    first = tone(0.2, 0.5)
    rows = [np.concatenate([one, other[1:]]) for one, other in zip(_states(first), _states(second), strict=True)]
    motion = Trajectory(first.names, np.arange(len(rows[0])) / RATE, *rows)
    found = foretell(Foresight(build("rigid_joint"), ParameterSettings(), RATE), motion)
    assert any(SAYS in note for note in found.notes) is told


def _states(motion: Trajectory) -> tuple[Array, Array, Array]:
    return motion.position, motion.velocity, motion.acceleration
