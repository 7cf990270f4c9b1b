"""Samples at rest: found with every sensor, and without a false one in motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare
from joint_id_core.estimators.shared.stillness import (
    STILL_S,
    WIND_UP_S,
    seen_by,
    still,
    still_link,
    surely_moves,
    wound_up,
)
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.sensors import ur_robot_sensors

PERIOD = 2e-3
TIME = np.arange(2000) * PERIOD
LABELS = ("link_position", "motor_velocity")


def moves(rest_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, motor velocity and rest of a joint that swings, stands for `rest_s`, and swings back."""
    begin = 1.5
    phase = 2.0 * np.pi * np.where(begin > TIME, TIME / begin, np.maximum(0.0, TIME - begin - rest_s) / begin)
    resting = (begin < TIME) & (begin + rest_s > TIME)
    q = 0.3 * np.sin(0.5 * phase) ** 2
    return q, 101.0 * np.gradient(q, PERIOD), resting


def measured(q, w, seed=0):
    rng = np.random.default_rng(seed)
    sensors = ur_robot_sensors()
    return np.array([sensors.reading("link_position", q, rng), sensors.reading("motor_velocity", w, rng)]).T


@given(rest_s=st.floats(0.2, 1.0), seed=st.integers(0, 50))
def test_a_rest_is_found_and_ends_where_motion_shows(rest_s, seed):
    q, w, resting = moves(rest_s)
    found = still(LABELS, measured(q, w, seed), PERIOD)
    assert found[resting].mean() > 0.9
    away = np.convolve(resting, np.ones(201), "same") == 0  # 0.2 s: the swing begins and ends at rest
    assert not found[away & (TIME > 0.2) & (TIME[-1] - 0.2 > TIME)].any()


@given(seed=st.integers(0, 50))
def test_a_fast_motion_has_no_rest_at_its_reversals(seed):
    q = 0.3 * np.sin(2.0 * np.pi * 2.0 * TIME)
    assert not still(LABELS, measured(q, 101.0 * np.gradient(q, PERIOD), seed), PERIOD).any()


@pytest.mark.parametrize("creep", [0.0, 1e-4], ids=["brake", "creep under load"])
def test_a_joint_at_rest_rests_all_the_time(creep):
    q = 0.7 + creep * TIME
    assert still(LABELS, measured(q, np.full(len(q), 101.0 * creep)), PERIOD).all()


@given(seed=st.integers(0, 50), begin=st.integers(0, 1900), missing=st.booleans())
def test_what_surely_moves_has_no_rest(seed, begin, missing):
    """The quick answer, of one label, is never that of a joint that `still` finds at rest."""
    y, noise = measured(*moves(0.4)[:2], seed), {"link_position": 1e-5, "motor_velocity": 0.1}
    part = y[begin : begin + 80].copy()
    if missing:
        part[::7] = np.nan
    sure = [
        surely_moves(name, np.ascontiguousarray(row), PERIOD, noise[name])
        for name, row in zip(LABELS, part.T, strict=True)
    ]
    if any(sure):
        assert not missing and not still(LABELS, part, PERIOD, noise).any()


def test_a_fast_joint_surely_moves():
    q = 0.5 * TIME[:80]
    assert surely_moves("link_position", q, PERIOD, 1e-5)
    assert not surely_moves("link_position", q[:20], PERIOD, 1e-5)  # too short to tell
    assert not surely_moves("link_position", q, PERIOD, 0.1)  # the noise hides it
    assert not surely_moves("current", q, PERIOD, 1e-5)


def swings_once(length_s: float, slow: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, motor velocity and motion of a joint that swings for 1.5 s; else it stands, or goes on slowly."""
    time = np.arange(round(length_s / PERIOD)) * PERIOD
    phase = np.clip((time - 5.0) / 1.5, 0.0, 1.0)
    q = 0.3 * np.sin(np.pi * phase) ** 2 + 0.5 * slow * (1.0 - np.cos(time))
    return q, 101.0 * np.gradient(q, PERIOD), (phase > 0.0) & (phase < 1.0)


@given(length_s=st.floats(15.0, 60.0), seed=st.integers(0, 20))
def test_a_joint_that_rests_nearly_all_of_the_time_is_found_at_rest(length_s, seed):
    q, w, moving = swings_once(length_s)
    found = still(LABELS, measured(q, w, seed), PERIOD)
    assert found[np.convolve(moving, np.ones(201), "same") == 0].mean() > 0.95
    assert not found[moving & (np.abs(w) > 2.0)].any()


@pytest.mark.parametrize("label", LABELS)
def test_a_slow_motion_that_noise_hides_beside_a_fast_one_is_no_rest(label):
    q, w, moving = swings_once(30.0, slow=0.03)
    values, noise = (q, 1e-3) if label == "link_position" else (w, 5.0)
    seen = values + noise * np.random.default_rng(0).standard_normal(len(values))
    assert not still((label,), seen[:, None], PERIOD)[~moving].any()


def test_a_coarse_encoder_says_nothing_about_rest():
    q = np.round(0.3 * np.sin(3.0 * TIME) / 0.01) * 0.01
    y = q[:, None]
    assert not still(("link_position",), y, PERIOD).any()
    assert not seen_by(("link_position",), y, PERIOD, {"link_position": 0.01})


def test_noise_is_not_rest():
    assert not still(("link_position",), np.random.default_rng(0).standard_normal((500, 1)), PERIOD).any()


def test_missing_values_and_short_records_do_no_harm():
    q, w, _ = moves(0.5)
    y = measured(q, w)
    y[::7] = np.nan
    assert still(LABELS, y, PERIOD).any()
    assert not still(LABELS, y[: round(STILL_S / PERIOD) // 2], PERIOD).any()
    assert not still(LABELS, np.full((100, 2), np.nan), PERIOD).any()


def test_samples_at_rest_have_no_labels_and_the_state_starts_again():
    q, w, resting = moves(0.5)
    y = measured(q, w)
    torque = np.sin(TIME)
    data = prepare(
        build("harmonic_drive"),
        Recording(TIME, {"link_position": y[:, 0], "motor_velocity": y[:, 1], "torque": torque}),
        leave_out_rests=True,
    )
    assert np.isnan(data.y[data.rest]).all() and np.isfinite(data.y[~data.rest]).all()
    assert data.rest[resting].mean() > 0.9
    assert len(data.starts) >= 1


def test_noise_of_a_resting_encoder_is_no_motion():
    y = measured(np.full(1000, 0.4), np.zeros(1000))
    recording = Recording(TIME[:1000], {"link_position": y[:, 0], "motor_velocity": y[:, 1], "torque": y[:, 0]})
    with pytest.raises(UnusableError, match="move the joint") as error:
        prepare(build("harmonic_drive"), recording, ParameterSettings(), leave_out_rests=True)
    assert error.value.status is Status.NO_MOTION


def sticking(stuck_s: float, frozen: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Position and motor velocity of a joint whose motor starts at 1 s, and whose link sticks for longer."""
    begin = 1.0
    speed = np.where(begin < TIME, 0.3 - 0.1 * np.cos(9.0 * (TIME - begin)), 0.0)
    moves = speed * (not frozen) * (begin + stuck_s < TIME)
    return np.cumsum(moves) * PERIOD, 101.0 * speed


def told_nothing(y: np.ndarray, parts: int = 1) -> np.ndarray:
    """Samples at which the joint or its link rests, found in so many parts."""
    rest, link, found, before = still(LABELS, y, PERIOD), still_link(LABELS, y, PERIOD), [], None
    for part in np.array_split(np.arange(len(y)), parts):
        one, before = wound_up(rest[part], link[part], PERIOD, before)
        found.append(one)
    return np.concatenate(found)


@pytest.mark.parametrize("stuck_s", [0.0, 0.05, 0.2])
def test_samples_at_which_the_motor_winds_up_the_gear_tell_nothing(stuck_s):
    found = told_nothing(measured(*sticking(stuck_s)))
    last = TIME[np.flatnonzero(found)[-1]]
    assert found[last > TIME].all()
    assert 1.0 + stuck_s - 0.01 < last < 1.0 + stuck_s + 0.02


def test_a_frozen_encoder_is_no_rest():
    found = told_nothing(measured(*sticking(0.0, frozen=True)))
    assert not found[TIME > 1.0 + WIND_UP_S + 0.02].any()


@given(stuck_s=st.floats(0.0, 0.5), parts=st.integers(1, 200))
def test_the_wind_up_is_the_same_in_parts(stuck_s, parts):
    y = measured(*sticking(stuck_s))
    np.testing.assert_array_equal(told_nothing(y, parts), told_nothing(y))


def test_a_joint_without_a_link_sensor_winds_up_nothing():
    q, w = sticking(0.2)
    y = measured(q, w)[:, 1:]
    rest = still(LABELS[1:], y, PERIOD)
    np.testing.assert_array_equal(wound_up(rest, still_link(LABELS[1:], y, PERIOD), PERIOD)[0], rest)
