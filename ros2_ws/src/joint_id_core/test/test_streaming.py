"""The streaming differentiator: equal to the whole-signal one, right at the stamp, late as stated."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.filtering.offline import FilterOptions, complete
from joint_id_core.filtering.streaming import StreamingFilter

from .streamed import PERIOD, W, column, jittered, motion, one_by_one, stream, times


@pytest.mark.parametrize("causal", [False, True])
@pytest.mark.parametrize("uneven", [False, True])
def test_equals_the_whole_signal_filter_on_noise(causal, uneven):
    time = jittered(1200, 0) if uneven else np.arange(1200) * PERIOD
    rng = np.random.default_rng(1)
    channels = {
        "link_position": rng.normal(size=(len(time), 2)).cumsum(0) * 0.01,
        "motor_velocity": rng.normal(size=(len(time), 2)),
        "current": rng.normal(size=(len(time), 2)),
    }
    options = FilterOptions(causal=causal)
    duration = time[-1] - time[0]
    period = duration / round(duration / np.median(np.diff(time)))  # the grid that the whole-signal filter lays
    samples = stream(StreamingFilter(options, period, cut=1e-6), time, channels)
    inner = slice(150, len(samples) - 150)
    for joint in range(2):
        whole = complete(Recording(time, {n: v[:, joint] for n, v in channels.items()}), options)
        assert samples[0].derived == whole.derived
        assert set(samples[0].channels) == set(whole.channels)
        for name in whole.channels:
            expected = whole[name][: len(samples)][inner]
            scale = np.abs(expected).max()
            np.testing.assert_allclose(
                column(samples, name, joint)[inner] / scale, expected / scale, atol=2e-5, err_msg=name
            )


@given(st.integers(0, 2**31), st.floats(0, 0.3), st.floats(0, 3e-4), st.floats(0, 1e6))
@settings(max_examples=10, deadline=None)
def test_derivatives_are_right_at_the_stamp_whatever_the_sampling(seed, holes, jitter, start):
    time = start + jittered(500, seed, holes, jitter)
    samples = stream(StreamingFilter(FilterOptions(max_gap=20), PERIOD), time, motion(time - start))
    t = times(samples)
    np.testing.assert_array_equal(t, time[: len(t)])
    truth = W * np.cos(np.multiply.outer(t - start, W))
    known = np.isfinite(column(samples, "link_velocity"))
    assert known[150:].all()
    for joint in range(3):
        velocity = column(samples, "link_velocity", joint)[known]
        np.testing.assert_allclose(velocity / W[joint], truth[known, joint] / W[joint], atol=1e-2)


@pytest.mark.parametrize("causal", [False, True])
def test_latency_is_as_stated(causal):
    time = np.arange(400) * PERIOD
    filtered = StreamingFilter(FilterOptions(causal=causal), PERIOD)
    lags = []
    for k, t in enumerate(time):
        for sample in one_by_one(filtered.push([t], {n: v[k : k + 1] for n, v in motion(time).items()})):
            lags.append(t - sample.time)
    lags = lags[1:]
    assert max(lags) <= filtered.latency + 1e-9
    assert max(lags) >= filtered.latency - 2 * PERIOD
    assert filtered.latency < (0.04 if causal else 0.09)


@pytest.mark.parametrize(("frequency", "error"), [(1.0, 1e-6), (5.0, 1e-5), (10.0, 6e-5), (30.0, 7e-4), (50.0, 2e-3)])
def test_the_short_lag_hardly_changes_what_the_whole_signal_gives(frequency, error):
    time = np.arange(1500) * PERIOD
    position = np.sin(2 * np.pi * frequency * time)
    samples = stream(StreamingFilter(period=PERIOD), time, {"link_position": position[:, None]})
    whole = complete(Recording(time, {"link_position": position}))
    inner = slice(300, 1200)
    for name in ("link_velocity", "link_acceleration"):
        expected = whole[name][inner]
        np.testing.assert_allclose(column(samples, name)[inner], expected, rtol=0, atol=error * np.abs(expected).max())


def test_the_short_lag_hardly_changes_noise():
    time = np.arange(3000) * PERIOD
    noise = np.random.default_rng(0).normal(size=3000)
    samples = stream(StreamingFilter(period=PERIOD), time, {"link_position": noise[:, None]})
    whole = complete(Recording(time, {"link_position": noise}))
    inner = slice(300, 2700)
    for name in ("link_velocity", "link_acceleration"):
        difference = column(samples, name)[inner] - whole[name][inner]
        assert np.std(difference) < 2e-3 * np.std(whole[name][inner])


def test_measured_values_pass_untouched_and_each_sample_once():
    time = jittered(400, 3)
    channels = motion(time)
    channels["current"][50:60, 1] = np.nan
    samples = stream(StreamingFilter(period=PERIOD), time, channels)
    n = len(samples)
    assert 0 < len(time) - n < 80
    np.testing.assert_array_equal(times(samples), time[:n])
    for name, values in channels.items():
        np.testing.assert_array_equal(np.array([s.channels[name] for s in samples]), values[:n])


def test_nothing_is_derived_until_the_filter_has_settled():
    time = np.arange(400) * PERIOD
    samples = stream(StreamingFilter(period=PERIOD), time, motion(time))
    velocity = column(samples, "link_velocity")
    first = int(np.flatnonzero(np.isfinite(velocity))[0])
    assert 0.05 < first * PERIOD < 0.2
    np.testing.assert_allclose(velocity[first:] / W[0], np.cos(W[0] * times(samples))[first:], atol=1e-4)


def test_causal_filters_every_channel_and_takes_its_delay_off_the_stamp():
    time = np.arange(600) * PERIOD
    filtered = StreamingFilter(FilterOptions(causal=True), PERIOD)
    samples = stream(filtered, time, motion(time))[150:]
    t = times(samples)
    truth = motion(t)
    for joint in range(3):
        for name, values in truth.items():
            scale = np.abs(values[:, joint]).max()
            np.testing.assert_allclose(column(samples, name, joint) / scale, values[:, joint] / scale, atol=2e-3)
        np.testing.assert_allclose(column(samples, "link_velocity", joint) / W[joint], np.cos(W[joint] * t), atol=2e-3)


def test_period_is_learnt_from_the_stamps_and_no_sample_is_lost():
    time = jittered(400, 5, holes=0.0)
    given, learnt = StreamingFilter(period=PERIOD), StreamingFilter()
    assert np.isnan(learnt.period) and np.isnan(learnt.latency)
    one, other = stream(given, time, motion(time)), stream(learnt, time, motion(time))
    assert learnt.period == pytest.approx(PERIOD, rel=0.05)
    assert abs(len(one) - len(other)) <= 5
    np.testing.assert_array_equal(times(other), time[: len(other)])
    np.testing.assert_allclose(
        column(other, "link_velocity")[150:], W[0] * np.cos(W[0] * times(other)[150:]), atol=1e-2
    )
