"""The filter and memory of one joint: new values that nothing confirms, and means outside of the bounds."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online import (
    OnlineIdentifier,
    OnlineOptions,
    input_noise,
    learning,
    pending_change,
    tracker,
)
from joint_id_core.online.follower import LOST, Follower, Found
from joint_id_core.online.knowledge import Knowledge
from joint_id_core.online.memory import BLOCK_S
from joint_id_core.online.noise_effects import weight
from joint_id_core.online.pending_change import PATIENT
from joint_id_core.online.relearn import relearn
from joint_id_core.online.task import Task
from joint_id_core.online.trial import TRIAL
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate

from .online_motion import MODEL, batches, motion

WINDOW_S = 2.0
CHANGES_AT = 8.0  # s


def task(**settings) -> Task:
    known = ParameterSettings(**settings)
    coordinates = Coordinates(MODEL, known.applied_to(MODEL)[1])
    return Task(MODEL, known, OnlineOptions(window_s=WINDOW_S), Innovations(), coordinates)


@functools.cache
def fitted(freed: tuple[str, ...] = ()) -> Estimate:
    """The fit of the first window."""
    fit = task(freed=freed).fit(motion().window(0.0, WINDOW_S), None)
    assert fit.converged
    return fit


def follow(one: Follower, recording: Recording, begin: float, end: float) -> None:
    window = SlidingWindow(WINDOW_S)
    for samples in batches(recording.window(begin, end)):
        window.append(samples)
        one.move(samples, window)


@pytest.fixture
def never_confirmed(monkeypatch):
    """New values are always found, but wrong, so that the next samples refute them; the numbers of blocks in use."""
    used, learn = [], learning.learn

    def wrong(tracker, stretches, change, coordinates, one_cause):
        used.append(len(stretches))
        found = learn(tracker, stretches, change, coordinates, one_cause)
        if found is None:
            return None
        off = 50.0 / np.sqrt(sum(np.diag(p.matrix) for p in found.learned.pieces))
        pieces = [replace(p, vector=p.vector + p.matrix @ off) for p in found.learned.pieces]
        return replace(found, learned=replace(found.learned, pieces=pieces))

    monkeypatch.setattr(pending_change, "learn", wrong)
    return used


def heavier(seconds: float = 20.0) -> Recording:
    """The input that a joint sees from `CHANGES_AT` on is a half of what is shown: all its torques seem doubled."""
    record = motion(seconds)
    return record.with_channels({"torque": record["torque"] * np.where(record.time < CHANGES_AT, 1.0, 2.0)})


def test_new_values_that_nothing_confirms_are_given_up_after_four_windows(never_confirmed):
    assert PATIENT == 4.0
    one = Knowledge.from_window(task(), fitted(), motion().window(0.0, WINDOW_S)).follower
    follow(one, heavier(), WINDOW_S, CHANGES_AT + PATIENT * WINDOW_S - 2.0 * BLOCK_S)
    assert one.found is Found.CHANGING and len(never_confirmed) > 10
    follow(one, heavier(), CHANGES_AT + PATIENT * WINDOW_S - 2.0 * BLOCK_S, CHANGES_AT + PATIENT * WINDOW_S + 2.0)
    assert one.found is Found.UNEXPLAINED
    tried = len(never_confirmed)
    follow(one, heavier(), CHANGES_AT + PATIENT * WINDOW_S + 2.0, 20.0)
    assert len(never_confirmed) == tried and max(never_confirmed) <= PATIENT * WINDOW_S / BLOCK_S + 1


def test_after_that_the_newest_window_is_fitted_by_itself(never_confirmed):
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=WINDOW_S))
    found = [e for e in map(identifier.update, batches(heavier(32.0))) if e is not None]
    end = CHANGES_AT + (PATIENT + TRIAL) * WINDOW_S + 2.0
    late = [e for e in found if e.end > end]
    assert late and all(e.converged for e in late)
    assert not any(e.converged for e in found if CHANGES_AT + BLOCK_S < e.end < end - 2.0)
    assert sum("what was known is forgotten" in e.message for e in found) == 1
    assert late[-1]["J"].value == pytest.approx(2.0 * found[0]["J"].value, rel=0.02)


def test_a_filter_that_diverges_at_every_start_is_given_up(monkeypatch):
    """A wrong guess left a joint a poor fit for 150 s, and for ever."""
    one = Knowledge.from_window(task(), fitted(), motion().window(0.0, WINDOW_S)).follower
    follow(one, motion(20.0), WINDOW_S, 4.0)
    monkeypatch.setattr(tracker.Tracker, "start", lambda self: [])
    one.rest()
    follow(one, motion(20.0), 4.0, 4.0 + PATIENT * WINDOW_S)
    assert one.found is Found.AGREES and one.tracker is None
    follow(one, motion(20.0), 4.0 + PATIENT * WINDOW_S, 4.5 + LOST * WINDOW_S)
    assert one.found is Found.UNEXPLAINED


def test_a_guess_at_which_the_filter_diverges_is_dropped(never_confirmed, monkeypatch):
    one = Knowledge.from_window(task(), fitted(), motion().window(0.0, WINDOW_S)).follower
    follow(one, heavier(), WINDOW_S, CHANGES_AT + 2.0)
    one.rest()
    wrong, start = one._coordinates.clip(one._pending.guess[1].mean), tracker.Tracker.start
    monkeypatch.setattr(tracker.Tracker, "start", lambda self: [] if np.array_equal(self.z, wrong) else start(self))
    tried = len(never_confirmed)
    follow(one, heavier(), CHANGES_AT + 2.0, CHANGES_AT + 2.0 + 3.0 * BLOCK_S)
    assert one.found is Found.CHANGING and one.tracker is not None
    assert len(never_confirmed) > tried


FREED = ("w_s",)  # it has a lower bound, far below which it is zero and the friction is not a number


def test_biases_after_a_change_are_those_of_all_samples_since_then(monkeypatch):
    """Without them a joint whose input is noisy had 5 sigma of bias in what it had just learned anew."""
    monkeypatch.setattr(tracker, "shown_noise", lambda data: {0: 1.0})
    monkeypatch.setattr(input_noise, "attenuation", lambda tracker, piece, rng: np.ones(len(piece.z)))
    one = Knowledge.from_window(task(), fitted(), motion().window(0.0, WINDOW_S)).follower
    follow(one, heavier(), WINDOW_S, CHANGES_AT + 2.0 * WINDOW_S)
    assert one.explanation is not None and one.explanation.all_new
    bias, count = one._refined._effects.biases(one.memory)[0], sum(map(weight, range(len(one.memory.blocks))))
    np.testing.assert_allclose(bias, one.memory.inverse @ np.full(len(bias), float(count)), rtol=0.1)


def test_new_noise_levels_do_not_move_what_hardly_a_sample_tells_anywhere(monkeypatch):
    """The Coulomb friction of a random flexible joint was published as 1e73 Nm, that of its motor as 1e-22 Nm."""
    one = Knowledge.from_window(task(), fitted(), motion().window(0.0, WINDOW_S)).follower
    refined, before, spread = one._refined, one.memory.mean.copy(), one._coordinates.spread
    monkeypatch.setattr(refined._effects, "learn", lambda *args, **kwargs: 1e3 * one.memory.matrix @ spread)
    refined._learn_noise(one.tracker, one.memory.blocks[-1:], anew=False)
    assert np.all(np.abs(one.memory.mean - before) < 1.01 * spread)


def test_means_outside_of_the_bounds_are_no_start_for_new_values():
    one = task(freed=FREED)
    free, j = fitted(FREED).free, fitted(FREED).free.index("w_s")
    known = Knowledge.from_window(one, fitted(FREED), motion().window(0.0, WINDOW_S))
    tracker, blocks = known.follower.tracker, known.follower.memory.blocks
    mean = known.follower.memory.mean.copy()
    mean[j] = -1000.0
    learned = relearn(tracker, blocks, mean, np.diag(one.coordinates.spread**-2.0), from_mean=True)
    assert learned is not None and np.isfinite(learned.z).all() and np.isfinite(learned.cost)
    assert np.all(learned.z >= one.coordinates.lower) and len(learned.z) == len(free)


@pytest.mark.parametrize("resting", [False, True])
def test_a_memory_outside_of_the_bounds_is_followed_and_told_within_them(resting):
    one, fit, window = task(freed=FREED), fitted(FREED), SlidingWindow(WINDOW_S)
    window.append(motion().window(0.0, WINDOW_S))
    known = Knowledge.from_window(one, fit, window.recording())
    mean, tracker = known.follower.memory.mean.copy(), known.follower.tracker
    mean[fit.free.index("w_s")] = -1000.0
    outside = Knowledge(one, fit, mean, known.follower.memory.covariance)
    if not resting:
        outside.follower.begin(tracker, [])
        assert np.all(tracker.z >= one.coordinates.lower)
    told = outside.estimate(window)
    assert told["w_s"].value >= MODEL.parameter("w_s").lower * (1.0 - 1e-9) and np.isfinite(told.covariance).all()
    follow(outside.follower, motion(), WINDOW_S, WINDOW_S + 2.0)
    assert outside.follower.tracker is not None and outside.follower.memory.blocks
    assert all(np.isfinite(part).all() for part in outside.follower.now())
