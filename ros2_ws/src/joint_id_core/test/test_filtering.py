"""The differentiator on whole recordings: against scipy, against closed forms, with gaps and missing values."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions, complete, differentiate

PERIOD = 0.002
TIME = np.arange(1000) * PERIOD
INNER = slice(100, -100)  # away from the ends, where the filter has seen enough to either side


def noise(n=1000, seed=0):
    return np.random.default_rng(seed).normal(size=n).cumsum()


@pytest.mark.parametrize("order", [1, 2, 4, 5])
@pytest.mark.parametrize("start", [0.0, 4385.574])
def test_even_samples_give_scipys_zero_phase_filter(order, start):
    x = noise()
    smoothed, _ = differentiate(start + TIME, x, FilterOptions(order=order, cutoff_hz=40.0))
    sos = scipy.signal.butter(order, 40.0, fs=1 / PERIOD, output="sos")
    np.testing.assert_allclose(smoothed, scipy.signal.sosfiltfilt(sos, x), atol=1e-7)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 20.0])
def test_sinusoid_has_the_filters_gain_no_phase_and_the_right_derivatives(frequency):
    w = 2 * np.pi * frequency
    smoothed, first, second = differentiate(TIME, np.sin(w * TIME), FilterOptions(), times=2)
    warp = np.tan(w * PERIOD / 2) / np.tan(np.pi * 50.0 * PERIOD)  # digital Butterworth: |H|^2 = 1 / (1 + warp^8)
    gain = 1 / (1 + warp**8)
    np.testing.assert_allclose(smoothed[INNER], gain * np.sin(w * TIME)[INNER], atol=2e-4)
    np.testing.assert_allclose(first[INNER] / w, gain * np.cos(w * TIME)[INNER], atol=2e-4)
    np.testing.assert_allclose(second[INNER] / w**2, -gain * np.sin(w * TIME)[INNER], atol=1e-3)


def test_quadratic_motion_is_exact():
    _, first, second = differentiate(TIME, 3 * TIME**2 - TIME, times=2)
    np.testing.assert_allclose(first[INNER], (6 * TIME - 1)[INNER], atol=1e-5)
    np.testing.assert_allclose(second[INNER], 6.0, atol=1e-3)


def test_noise_above_the_cutoff_is_removed():
    x = np.sin(2 * np.pi * 200 * TIME)
    smoothed, first = differentiate(TIME, x)
    assert np.abs(smoothed[INNER]).max() < 1e-5
    assert np.abs(first[INNER]).max() < 1e-3 * 2 * np.pi * 200


@given(st.floats(-100, 100), st.floats(-100, 100), st.integers(0, 2**31), st.booleans())
@settings(max_examples=20, deadline=None)
def test_linear(a, b, seed, causal):
    options = FilterOptions(causal=causal)
    x, y = noise(300, seed), noise(300, seed + 1)
    keep = np.random.default_rng(seed).random(300) > 0.1
    time = TIME[:300][keep]
    both = np.array(differentiate(time, (a * x + b * y)[keep], options, 2))
    apart = a * np.array(differentiate(time, x[keep], options, 2)) + b * np.array(
        differentiate(time, y[keep], options, 2)
    )
    scale = np.abs(apart).max(axis=1, keepdims=True) + 1e-3
    np.testing.assert_allclose(both / scale, apart / scale, atol=1e-9)


@given(st.integers(-(10**6), 10**6), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_shifting_the_time_changes_nothing(shift, seed):
    x = noise(300, seed)
    one = differentiate(TIME[:300], x)
    other = differentiate(TIME[:300] + shift, x)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5 * np.abs(a).max())


def test_small_holes_are_bridged_and_nothing_is_invented():
    rng = np.random.default_rng(1)
    keep = rng.random(1000) > 0.1
    keep[400:404] = False  # a hole of five periods
    keep[399] = keep[404] = True
    time, w = TIME[keep], 2 * np.pi * 3
    smoothed, first = differentiate(time, np.sin(w * time))
    assert smoothed.shape == time.shape
    assert np.isfinite(first).all()
    np.testing.assert_allclose(first[INNER] / w, np.cos(w * time)[INNER], atol=1e-3)


def test_missing_values_stay_missing_and_their_neighbours_do_not_suffer():
    x, w = np.sin(2 * np.pi * 3 * TIME), 2 * np.pi * 3
    x[[300, 301, 600]] = np.nan
    smoothed, first = differentiate(TIME, x)
    assert np.flatnonzero(np.isnan(smoothed)).tolist() == [300, 301, 600]
    valid = np.isfinite(first)
    np.testing.assert_allclose(first[valid][INNER] / w, np.cos(w * TIME)[valid][INNER], atol=1e-4)


def test_a_long_gap_cuts_the_signal_in_two():
    keep = (TIME < 0.9) | (TIME > 0.92)
    time, x = TIME[keep], noise()[keep]
    split = int(np.flatnonzero(np.diff(time) > 0.01)[0]) + 1
    whole = differentiate(time, x)
    before, after = differentiate(time[:split], x[:split]), differentiate(time[split:], x[split:])
    parts = [np.concatenate(pair) for pair in zip(before, after, strict=True)]
    for a, b in zip(whole, parts, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max())


def test_pieces_too_short_to_filter_give_nothing():
    time = np.concatenate([TIME[:10], TIME[100:300]])
    smoothed, first = differentiate(time, np.sin(time))
    assert np.isnan(smoothed[:10]).all() and np.isnan(first[:10]).all()
    assert np.isfinite(smoothed[10:]).all()
    assert np.isnan(differentiate(TIME[:3], np.zeros(3))[0]).all()
    assert np.isnan(differentiate(TIME, np.full(1000, np.nan))[0]).all()


def test_uneven_steps_are_honoured():
    rng = np.random.default_rng(2)
    time, w = TIME + rng.uniform(-4e-4, 4e-4, 1000), 2 * np.pi * 3
    _, first = differentiate(time, np.sin(w * time))
    np.testing.assert_allclose(first[INNER] / w, np.cos(w * time)[INNER], atol=1e-4)
    naive = np.gradient(np.sin(w * time), PERIOD)  # what a filter does that takes the steps for even
    assert np.abs(naive[INNER] / w - np.cos(w * time)[INNER]).max() > 0.1


def test_sampling_too_slow_for_the_cutoff():
    time = np.arange(100) * 0.02
    message = r"log.csv: cutoff_hz = 50 Hz needs more than 100 samples/s, there are 50: set cutoff_hz below 25 Hz"
    record = Recording(time, {"link_position": np.sin(6.0 * time)}, source="log.csv")
    with pytest.raises(JointIdError, match=message):
        complete(record, FilterOptions())
    velocity = complete(record)["link_velocity"]  # nothing was asked for: the highest cutoff that fits, 20 Hz
    np.testing.assert_allclose(velocity, complete(record, FilterOptions(cutoff_hz=20.0))["link_velocity"], rtol=1e-9)
    np.testing.assert_allclose(velocity[20:-20], 6.0 * np.cos(6.0 * time[20:-20]), atol=0.01)
    with pytest.raises(JointIdError, match=r"set cutoff_hz below 50 Hz"):  # the cutoff at the Nyquist frequency itself
        differentiate(time / 2, time)


@pytest.mark.parametrize(
    "wrong", [{"cutoff_hz": 0.0}, {"order": 0}, {"order": 9}, {"max_gap": 1.0}, {"cutoff_hz": np.nan}]
)
def test_options_are_checked(wrong):
    with pytest.raises(JointIdError, match=rf"option {next(iter(wrong))} = "):
        FilterOptions(**wrong)


def test_complete_adds_what_was_not_measured_and_touches_nothing_else():
    w = 2 * np.pi * 2
    position, velocity = np.sin(w * TIME), 101 * w * np.cos(w * TIME) + noise(seed=3) * 1e-3
    current = np.where(np.arange(1000) % 7, np.arange(1000.0), np.nan)
    recording = Recording(
        TIME, {"link_position": position, "motor_velocity": velocity, "current": current}, source="log"
    )
    result = complete(recording)
    assert result.derived == {"link_velocity", "link_acceleration", "motor_acceleration"}
    for name, values in recording.channels.items():
        np.testing.assert_array_equal(result[name], values)
    np.testing.assert_array_equal(result["motor_acceleration"], differentiate(TIME, velocity)[1])
    np.testing.assert_allclose(result["link_acceleration"][INNER] / w**2, -position[INNER], atol=1e-4)
    again = complete(result)
    assert again.derived == result.derived
    np.testing.assert_array_equal(again["link_acceleration"], result["link_acceleration"])


def test_measured_velocity_and_acceleration_are_kept():
    measured = {name: noise(seed=k) for k, name in enumerate(["link_position", "link_velocity", "link_acceleration"])}
    result = complete(Recording(TIME, measured))
    assert not result.derived
    assert set(result.channels) == set(measured)


def test_causal_channels_stay_aligned_at_the_stated_time():
    w = 2 * np.pi * 2
    channels = {"link_position": np.sin(w * TIME), "current": np.cos(w * TIME), "motor_velocity": np.sin(w * TIME)}
    options = FilterOptions(causal=True)
    result = complete(Recording(TIME, channels), options)
    delay = scipy.signal.group_delay(scipy.signal.butter(4, 50.0, fs=1 / PERIOD), [1e-4])[1][0] * PERIOD
    np.testing.assert_allclose(TIME - result.time, delay, rtol=1e-4)
    t = result.time
    truths = {"link_position": np.sin(w * t), "current": np.cos(w * t), "link_velocity": w * np.cos(w * t)}
    truths |= {"motor_acceleration": w * np.cos(w * t), "link_acceleration": -(w**2) * np.sin(w * t)}
    for name, truth in truths.items():
        np.testing.assert_allclose(result[name][INNER], truth[INNER], atol=2e-4 * np.abs(truth).max(), err_msg=name)


def test_causal_never_looks_ahead():
    x = noise()
    changed = x.copy()
    changed[500:] += 10.0
    options = FilterOptions(causal=True)
    np.testing.assert_array_equal(
        differentiate(TIME, x, options)[0][:499], differentiate(TIME, changed, options)[0][:499]
    )
