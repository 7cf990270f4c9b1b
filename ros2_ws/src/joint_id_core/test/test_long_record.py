"""Recordings of hours: a fit takes a bounded number of samples, from all of the motion, and says so."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, Regression, fit
from joint_id_core.estimators.shared import long_record
from joint_id_core.estimators.shared.long_record import REST_S, STRETCHES, fitted_part
from joint_id_core.models import build

from .friction_record import TRUTH, rigid

RIGID = build("rigid_joint")
MOST, RATE = 2000, 100


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(long_record, "MOST", MOST)


def record(samples: int, moves: np.ndarray | None = None) -> Recording:
    """A position that swings where `moves` (T,) is true, and stands elsewhere."""
    time = np.arange(samples) / RATE
    speed = np.cos(3.0 * time) * (1.0 if moves is None else moves)
    position = np.cumsum(speed) / RATE + 1e-6 * np.random.default_rng(1).standard_normal(samples)
    return Recording(time, {"link_position": position, "torque": speed})


def test_a_recording_that_is_short_enough_is_taken_as_it_is():
    short = record(MOST)
    assert fitted_part(RIGID, short) is short


def test_of_a_longer_one_stretches_come_from_all_of_the_motion():
    whole = record(10 * MOST)
    part = fitted_part(RIGID, whole)
    assert len(part) == MOST
    rows = np.searchsorted(whole.time, part.time)
    for name in whole.channels:
        np.testing.assert_array_equal(part[name], whole[name][rows])
    assert part.gaps == STRETCHES - 1
    assert rows[0] == 0 and rows[-1] == len(whole) - 1
    assert np.histogram(rows, 10, (0, len(whole)))[0].min() > 0


def test_rests_are_left_out_before_motion_is():
    moves = np.zeros(10 * MOST, dtype=bool)
    moves[3000:3600] = moves[15000:15400] = True
    whole = record(len(moves), moves)
    part = fitted_part(RIGID, whole)
    rows = np.searchsorted(whole.time, part.time)
    assert np.isin(np.flatnonzero(moves), rows).all(), "all of the motion is kept"
    around = round(REST_S * RATE)
    assert len(part) <= moves.sum() + 2 * 2 * (around + 2)


def test_a_joint_that_never_moves_is_told_as_in_a_short_recording():
    estimate = fit(RIGID, record(2 * MOST, np.zeros(2 * MOST, dtype=bool)))
    assert estimate.status.value == "no_motion"


@pytest.mark.parametrize("estimator", [Innovations(), Regression()], ids=lambda e: e.name)
def test_a_fit_of_a_part_is_right_and_says_of_how_many_samples_it_is(estimator, monkeypatch):
    monkeypatch.setattr(long_record, "MOST", 1200)
    whole = rigid("coulomb_viscous")
    estimate = fit(RIGID, whole, estimator=estimator)
    assert estimate.samples <= 1200 < len(whole)
    assert any("1,200 of 1,600 samples" in note and "--start" in note for note in estimate.notes)
    for name in ("J", "c", "tau_f"):
        assert abs(estimate[name].value - TRUTH[name]) < 4.0 * estimate[name].std_dev, name
