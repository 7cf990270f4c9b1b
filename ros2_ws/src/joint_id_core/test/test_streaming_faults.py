"""The streaming differentiator where samples are missing, late or wrong, and where channels and batches change."""

import numpy as np
import pytest

from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import StreamingFilter

from .streamed import PERIOD, W, column, jittered, motion, stream, times


def test_sampling_too_slow_for_the_cutoff_gets_the_highest_one_that_fits_and_says_so():
    """A log of 100 samples/s has nothing above 50 Hz; no sample is lost."""
    time = np.arange(300) * 0.01
    learnt = StreamingFilter()
    samples = stream(learnt, time, motion(time))
    assert learnt.counts == {"rate": 1}
    assert learnt.events[0] == "cutoff_hz = 50 Hz is too high for 100 samples/s: 40 Hz is taken"
    known = times(samples)
    assert np.array_equal(known, time[: len(known)]) and known[-1] > 2.5
    velocity = column(samples, "link_velocity")
    inner = (known > 0.5) & np.isfinite(velocity)
    assert np.abs(velocity[inner] / W[0] - np.cos(W[0] * known[inner])).max() < 0.02
    assert StreamingFilter(period=0.01).latency < 0.5


def test_a_rate_that_allows_the_cutoff_but_for_its_jitter_is_not_told():
    """A UR of the CB series: of 125 samples/s 50 Hz is the highest, and its stamps say 124.99."""
    time = np.arange(300) / 124.99
    learnt = StreamingFilter()
    stream(learnt, time, motion(time))
    assert not learnt.counts


def test_hardly_any_sample_at_all_is_said():
    learnt = StreamingFilter()
    time = np.arange(60) * 10.0
    samples = stream(learnt, time, motion(time))
    assert learnt.counts["rate"] >= 1 and np.isnan(column(samples, "link_velocity")).all()


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
