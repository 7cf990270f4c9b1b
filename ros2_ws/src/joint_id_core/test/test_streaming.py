"""The streaming differentiator: equal to the whole-signal one, and honest about everything that disturbs it."""

import itertools
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions, complete
from joint_id_core.filtering.streaming import StreamingFilter

PERIOD = 0.002
W = 2 * np.pi * np.array([1.0, 2.0, 3.5])  # one frequency a joint


def motion(time):
    position = np.sin(np.multiply.outer(time, W))
    return {
        "link_position": position,
        "motor_velocity": 101 * W * np.cos(np.multiply.outer(time, W)),
        "current": position**2,
    }


class Sample(NamedTuple):
    """All joints at one instant."""

    time: float
    channels: dict
    derived: frozenset


def one_by_one(batches):
    return [
        Sample(time, {name: values[k] for name, values in batch.channels.items()}, batch.derived)
        for batch in batches
        for k, time in enumerate(batch.times)
    ]


def stream(stream_filter, time, channels, sizes=(1, 3, 2, 40)):
    """Push the samples in batches of these sizes, over and over."""
    done, k = [], 0
    for size in itertools.cycle(sizes):
        if k >= len(time):
            return done
        rows = slice(k, k + size)
        done += one_by_one(stream_filter.push(time[rows].tolist(), {n: v[rows] for n, v in channels.items()}))
        k += size


def column(samples, name, joint=0):
    return np.array([s.channels[name][joint] for s in samples])


def times(samples):
    return np.array([s.time for s in samples])


def jittered(n, seed, holes=0.05, jitter=1e-4):
    rng = np.random.default_rng(seed)
    keep = rng.random(n) >= holes
    return (np.arange(n) * PERIOD + rng.uniform(-jitter, jitter, n))[keep]


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


def test_sampling_too_slow_for_the_cutoff():
    with pytest.raises(JointIdError, match="set cutoff_hz below 25 Hz"):
        StreamingFilter(period=0.02)
    time = np.arange(120) * 0.02
    learnt = StreamingFilter()
    samples = stream(learnt, time, motion(time))
    assert learnt.counts == {"rate": 2}
    assert "set cutoff_hz below 25 Hz" in learnt.events[0]
    assert len(samples) == 100 and np.isnan(column(samples, "link_velocity")).all()


def test_long_gap_restarts_without_a_wrong_number():
    time = np.arange(800) * PERIOD
    time[400:] += 0.5
    channels = motion(time)
    channels["link_position"][400:] += 7.0  # unseen motion in the gap
    filtered = StreamingFilter(period=PERIOD)
    samples = stream(filtered, time, channels)
    assert filtered.counts == {"gap": 1}
    assert filtered.events[0].startswith("no sample from 0.798 s to 1.3 s (0.502 s): filter restarted")
    t = times(samples)
    np.testing.assert_array_equal(t, time[: len(t)])
    velocity = column(samples, "link_velocity")
    known = np.isfinite(velocity)
    assert not known[(t > 0.72) & (t < 1.4)].any()
    assert known[(t > 0.2) & (t < 0.6)].all() and known[t > 1.5].all()
    np.testing.assert_allclose(velocity[known] / W[0], np.cos(W[0] * t[known]), atol=1e-4)


def test_value_that_is_not_finite_spoils_only_its_own_joint_and_channel_for_a_while():
    time = np.arange(800) * PERIOD
    channels = motion(time)
    channels["link_position"][400, 1] = np.nan
    channels["motor_velocity"][600:602, 2] = np.inf
    filtered = StreamingFilter(period=PERIOD)
    samples = stream(filtered, time, channels)
    assert filtered.counts == {"value": 2}
    assert list(filtered.events) == [
        "link_position[1] at 0.8 s: not finite, left out for that joint",
        "motor_velocity[2] at 1.2 s: not finite, left out for that joint",
    ]
    t = times(samples)
    for joint in range(3):
        velocity = column(samples, "link_velocity", joint)
        known = np.isfinite(velocity)
        hurt = (t > 0.2) & ~known
        assert hurt.any() == (joint == 1)
        assert not known[400] or joint != 1
        assert np.abs(t[hurt] - 0.8).max(initial=0) < 0.2
        np.testing.assert_allclose(velocity[known] / W[joint], np.cos(W[joint] * t[known]), atol=1e-4)
    acceleration = column(samples, "motor_acceleration", 2)
    known = np.isfinite(acceleration)
    assert known[(t > 0.2) & (t < 1.0)].all() and not known[(t > 1.19) & (t < 1.21)].any()
    np.testing.assert_allclose(
        acceleration[known], -101 * W[2] ** 2 * np.sin(W[2] * t[known]), atol=101 * W[2] ** 2 * 1e-4
    )


def test_joint_that_is_never_measured_stays_unknown():
    time = np.arange(400) * PERIOD
    channels = motion(time)
    channels["link_position"][:, 0] = np.nan
    filtered = StreamingFilter(period=PERIOD)
    samples = stream(filtered, time, channels)
    assert filtered.counts == {"value": 1}
    assert np.isnan(column(samples, "link_velocity", 0)).all()
    assert np.isfinite(column(samples, "link_velocity", 1)[150:]).all()


def test_bad_stamps_are_left_out_and_a_jump_back_restarts():
    time = np.arange(600) * PERIOD
    channels = motion(time)
    filtered = StreamingFilter(period=PERIOD)
    samples = stream(filtered, time, channels)
    last = {name: values[-1:] for name, values in channels.items()}
    for stamp in (time[-1], time[-2], np.nan, np.inf):
        assert filtered.push([stamp], last) == []
    assert filtered.counts == {"time": 4}
    assert [e.split(":")[0] for e in filtered.events] == [
        "stamp 1.198 s repeats",
        "stamp 1.196 s is out of order",
        "stamp nan s is not finite",
        "stamp inf s is not finite",
    ]
    again = stream(filtered, time, channels)
    assert filtered.events[-1] == "time jumps back from 1.198 s to 0 s: filter restarted"
    tail = len(time) - len(samples)
    np.testing.assert_array_equal(times(again)[:tail], time[-tail:])
    assert np.isnan(column(again[:tail], "link_velocity")).all()
    np.testing.assert_array_equal(column(again[tail:], "link_velocity"), column(samples, "link_velocity"))


def test_change_of_channels_or_joints_restarts():
    time = np.arange(600) * PERIOD
    channels = motion(time)
    filtered = StreamingFilter(period=PERIOD)
    stream(filtered, time[:300], {n: v[:300] for n, v in channels.items()})
    samples = stream(filtered, time[300:], {"motor_position": channels["current"][300:, :1]})
    assert filtered.events[-1] == "channels or joints change at 0.6 s: filter restarted"
    assert samples[-1].derived == {"motor_velocity", "motor_acceleration"}
    assert samples[-1].channels["motor_velocity"].shape == (1,)


def test_channels_without_derivatives_pass():
    filtered = StreamingFilter(period=PERIOD)
    done = stream(filtered, np.arange(200) * PERIOD, {"current": np.arange(200.0)[:, None]})
    assert column(done, "current").tolist() == list(range(len(done)))
    assert len(done) > 100 and not done[0].derived


@pytest.mark.parametrize("causal", [False, True])
def test_the_split_into_batches_changes_nothing(causal):
    time = jittered(700, 4)
    time[300:] += 0.5  # a gap
    time[400] = time[399]  # repeats
    channels = motion(time)
    channels["link_position"][500:503, 1] = np.nan
    one, other = (StreamingFilter(FilterOptions(causal=causal)) for _ in range(2))
    expected = stream(one, time, channels, sizes=(1,))
    found = stream(other, time, channels, sizes=(1, 7, 2, 64, 300))
    assert one.counts == other.counts == {"gap": 1, "time": 1, "value": 1} and one.events == other.events
    assert times(found).tolist() == times(expected).tolist() and len(found) > 400
    for a, b in zip(expected, found, strict=True):
        assert a.derived == b.derived and set(a.channels) == set(b.channels)
        for name in a.channels:
            np.testing.assert_array_equal(a.channels[name], b.channels[name])


def test_the_order_of_the_channels_may_change():
    time = np.arange(400) * PERIOD
    channels = motion(time)
    filtered, mixed = StreamingFilter(period=PERIOD), StreamingFilter(period=PERIOD)
    expected = stream(filtered, time, channels)
    half = {n: v[:200] for n, v in channels.items()}, {n: v[200:] for n, v in reversed(channels.items())}
    found = stream(mixed, time[:200], half[0]) + stream(mixed, time[200:], half[1])
    assert not mixed.counts
    for name in expected[0].channels:
        np.testing.assert_array_equal(column(found, name, 1), column(expected, name, 1)[: len(found)])
