"""Samples that arrive, handed on as motion or rest: each once, marked as in the whole record, and how soon."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.shared.stillness import STILL_S, still, sure_speed
from joint_id_core.models import build
from joint_id_core.online.motion import MotionWatch

from .examples import TIMES

PERIOD = 2e-3
REST_S = 0.051  # no multiple of the period
NOISE = {"link_position": 1e-5, "motor_velocity": 0.1}
MODEL = build("harmonic_drive", actuation="current")


def swings(rests, seed, channels=tuple(NOISE)):
    """A joint that swings, and stands for each of `rests` (s) in between, where its speed is zero."""
    rng = np.random.default_rng(seed)
    swing = 0.3 * np.sin(np.pi * np.arange(0.0, 1.0, PERIOD)) ** 2
    parts = [swing]
    for rest in rests:
        parts += [np.zeros(round(rest / PERIOD)), swing]
    q = np.concatenate(parts)
    true = {"link_position": q, "motor_velocity": 101.0 * np.gradient(q, PERIOD)}
    seen = {name: true[name] + NOISE[name] * rng.standard_normal(len(q)) for name in channels}
    return Recording(np.arange(len(q)) * PERIOD, seen)


def handed_on(recording, sizes, noise=NOISE):
    """Marks of the samples that were handed on, and how far they were behind after each batch."""
    watch, marks, behind, begin, k = MotionWatch(MODEL, 2.0), [], [], 0, 0
    watch.noise = {name: sigma for name, sigma in noise.items() if name in recording}
    while begin < len(recording):
        batch = recording.slice(begin, begin + sizes[k % len(sizes)])
        begin, k = begin + len(batch), k + 1
        watch.recent.append(batch)
        for part, moves in watch.stretches(now=True):
            np.testing.assert_array_equal(part.time, recording.time[len(marks) : len(marks) + len(part)])
            marks += [moves] * len(part)
        behind.append(begin - len(marks))
    return np.array(marks), np.array(behind)


@settings(max_examples=15 * TIMES, deadline=None)
@given(
    rests=st.lists(st.floats(0.0, 0.4), max_size=3),
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=4),
    seed=st.integers(0, 20),
    channels=st.sampled_from([tuple(NOISE), ("link_position",)]),
)
def test_each_sample_is_handed_on_once_and_marked_as_in_the_whole_record(rests, sizes, seed, channels):
    recording = swings(rests, seed, channels)
    marks, _ = handed_on(recording, sizes)
    y = np.array([recording[name] for name in channels]).T
    at_rest = still(channels, y, PERIOD, NOISE)[: len(marks)]
    np.testing.assert_array_equal(~marks[at_rest], True)
    # Beside a rest the link may stick a little longer than the motor.
    np.testing.assert_array_equal(marks[~np.convolve(at_rest, np.ones(301), "same").astype(bool)], True)


def test_a_joint_in_motion_does_not_wait_for_what_its_speed_tells_already():
    _, behind = handed_on(swings([], 0), [10])
    moving = behind[5:-5]  # the swing begins and ends slowly
    assert np.median(moving) == 0
    assert moving.max() <= 20  # at the reversal, 40 ms


def test_without_a_speed_samples_wait_until_the_joint_has_moved_on():
    recording = swings([], 0, ("link_position",))
    _, behind = handed_on(recording, [10])
    moving = behind[5:-5]
    assert np.median(moving) <= 3
    assert np.all(moving[10:30] <= 5)  # well away from the reversal
    assert moving.max() <= STILL_S / PERIOD + 1  # at the reversal


def test_a_reversal_that_lasts_longer_than_a_rest_delays_nothing_after_it():
    """Once the joint is fast again, the slow samples before it are known to be no rest."""
    q = 0.05 * np.sin(2.0 * np.pi * 0.5 * np.arange(0.0, 4.0, PERIOD))
    rng = np.random.default_rng(0)
    speed = 101.0 * np.gradient(q, PERIOD) + NOISE["motor_velocity"] * rng.standard_normal(len(q))
    recording = Recording(np.arange(len(q)) * PERIOD, {"link_position": q, "motor_velocity": speed})
    marks, behind = handed_on(recording, [10])
    slow = np.abs(speed) < sure_speed("motor_velocity", NOISE["motor_velocity"])
    lengths = np.diff(np.flatnonzero(np.diff(slow.astype(int), prepend=0, append=0)))[::2]
    assert lengths.max() * PERIOD > STILL_S
    assert marks.all()
    ends = np.minimum(10 * np.arange(1, len(behind) + 1), len(q)) - 1
    since = np.arange(len(q)) - np.maximum.accumulate(np.where(slow, -1, np.arange(len(q))))  # samples that are slow
    np.testing.assert_array_equal(behind[20:] <= since[ends][20:], True)


@given(seed=st.integers(0, 10**6), count=st.integers(1, 80), gap=st.sampled_from([1, 1, 1, 3]))
def test_a_sample_that_is_sure_to_move_belongs_to_no_rest_whatever_follows(seed, count, gap):
    """Against a plain form: no stretch of a rest holds a fast sample, so each has one within the length of a rest."""
    rng = np.random.default_rng(seed)
    steps = np.full(count, PERIOD)
    steps[rng.integers(count)] *= gap
    time, least = 10.0 + np.cumsum(steps), 1.0
    speed = np.where(rng.random(count) < rng.choice([0.02, 0.05, 0.5]), 2.0, 0.5) * rng.choice([-1.0, 1.0], count)
    speed[rng.random(count) < 0.05] = np.nan
    fast = [-1, *np.flatnonzero(np.abs(speed) > least).tolist()]
    expected = 0
    for before, after in pairwise(fast):
        if (after - before) * np.mean(steps) > REST_S:
            break
        expected = after + 1
    found = compile_shared().moving(time, speed, 10.0, least, REST_S, 1.5)
    assert found == (expected if gap == 1 or count == 1 else 0)


def test_speeds_of_labels_that_show_no_rest():
    assert sure_speed("link_position", 1e-5) == np.inf
    assert sure_speed("motor_velocity", 1e6) == np.inf
    assert 1.6 < sure_speed("motor_velocity", 0.1) < 3.0
    assert sure_speed("motor_velocity", 0.2) > 1.5 * sure_speed("motor_velocity", 0.1)
    assert pytest.approx(2.0 * 8.0 * 0.01, rel=0.5) == sure_speed("link_velocity", 0.01)
