"""Whether joints move, and whether they follow a trajectory, from noisy positions."""

import numpy as np
import pytest

from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.trajectory_watch import MOVED, REST_S, TrajectoryWatch

RATE = 50.0
NOISE = 2e-5
NAMES = ("a", "b")
MOTION = FourierMotion(NAMES, [0.3, -1.0], [[0.05, 0.02]] * 2, [[0.04, -0.03]] * 2, [0.4, 1.0], 8.0, 1.0).sampled(125.0)


def watched(parts, seed=0, start=1e9):
    """A watch of parts: (seconds, function of the time in the part that gives positions)."""
    watch, rng, time = TrajectoryWatch(), np.random.default_rng(seed), start
    states = []
    for seconds, place in parts:
        for k in range(round(seconds * RATE)):
            q = np.asarray(place(k / RATE)) + NOISE * rng.standard_normal(2)
            watch.add(time, q.tolist())
            states.append((time - start, watch.moving, watch.rest_s, watch.motion_s, watch.paused(MOTION)))
            time += 1 / RATE
    return watch, states


def rest(_):
    return 0.3, -1.0


def follow(t):
    return MOTION.at(t).position[0]


def approach(t):
    """0.3 rad to the start, smoothly, within two seconds."""
    x = min(1.0, t / 2.0)
    return 0.3 - 0.3 * (1 - x**3 * (10 - 15 * x + 6 * x * x)), -1.0


def test_joints_at_rest_do_not_move():
    watch, states = watched([(5.0, rest)])
    assert not any(moving for _, moving, *_ in states)
    assert watch.rest_s == pytest.approx(5.0, abs=0.1) and watch.motion_s == 0.0 and not watch.paused(MOTION)


def test_a_trajectory_after_an_approach_is_one_motion_and_is_found():
    parts = [(3.0, lambda t: approach(0.0)), (2.5, approach), (8.0, follow), (2.5, rest)]
    watch, states = watched(parts)
    began = next(t for t, moving, *_ in states if moving)
    assert 3.0 < began < 3.6
    ended = next(t for t, *_, paused in states if paused)
    assert 13.5 - 1.0 + REST_S < ended < 13.5 + REST_S + 0.3
    begin, off = watch.matched(MOTION)
    assert begin - 1e9 == pytest.approx(5.5, abs=0.02) and off < 2e-3
    assert watch.motion_s == pytest.approx(13.5 - began, abs=0.8)


def test_a_short_pause_does_not_end_a_motion_and_a_long_one_does():
    for pause, joined in ((0.6, True), (REST_S + 0.6, False)):
        watch, _ = watched([(1.0, rest), (8.0, follow), (pause, rest), (8.0, follow), (0.5, rest)])
        assert (watch.motion_s > 14.0) is joined


def test_a_motion_that_ends_early_is_no_trajectory():
    half = follow(3.0)
    watch, states = watched([(2.0, rest), (3.0, follow), (4.0, lambda t: half)])
    assert not any(paused for *_, paused in states)
    assert watch.rest_s == pytest.approx(4.0, abs=0.3)


def test_another_motion_of_the_same_length_does_not_match():
    watch, states = watched([(2.0, rest), (8.0, lambda t: (0.3 + 0.4 * np.sin(3.0 * t), -1.0)), (2.0, rest)])
    assert states[-1][-1]
    assert watch.matched(MOTION)[1] > 0.15


def test_slow_drift_is_no_motion_and_times_that_do_not_rise_are_left_out():
    watch, states = watched([(20.0, lambda t: (0.3 + 0.2 * MOVED * t, -1.0))])
    assert not any(moving for _, moving, *_ in states)
    before = watch.rest_s
    watch.add(1e9, [5.0, 5.0])
    assert watch.rest_s == before


def test_a_long_wait_is_forgotten_and_counts_as_rest():
    watch, _ = watched([(90.0, rest), (8.0, follow), (2.0, rest)])
    assert len(watch._time) < 1500  # of 5000
    begin, off = watch.matched(MOTION)
    assert begin - 1e9 == pytest.approx(90.0, abs=0.02) and off < 2e-3
    watch, _ = watched([(90.0, rest)])
    assert len(watch._time) < 1100 and watch.rest_s == pytest.approx(90.0, abs=0.1)


def test_a_missing_position_is_left_out():
    watch, _ = watched([(2.0, rest), (4.0, lambda t: (np.nan, -1.0)), (8.0, follow), (2.0, rest)])
    assert watch.paused(MOTION) and watch.matched(MOTION)[1] < 2e-3
