"""The sliding window against a list of all samples."""

from __future__ import annotations

import weakref

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.online.window import SlidingWindow

PERIOD = 0.01
NAMES = ("link_position", "torque", "temperature")

parts = st.lists(
    st.tuples(st.integers(1, 400), st.floats(0.0, 3.0), st.sets(st.sampled_from(NAMES), min_size=1)),
    min_size=1,
    max_size=25,
)


def recordings(sizes):
    """Parts of consecutive samples with pauses between them; every value is the number of its sample."""
    begin, number = 0.0, 0
    for count, pause, names in sizes:
        values = np.arange(number, number + count, dtype=float)
        yield Recording(begin + PERIOD * np.arange(count), {name: values for name in sorted(names)})
        begin, number = begin + PERIOD * count + pause, number + count


@given(sizes=parts, length=st.floats(0.05, 5.0))
def test_it_holds_the_newest_samples_and_their_channels(sizes, length):
    window, all_parts = SlidingWindow(length), []
    for part in recordings(sizes):
        window.append(part)
        all_parts.append(part)
        held, count = window.recording(), len(window)
        assert len(held) == count
        assert held.time[-1] == window.end == part.time[-1]
        np.testing.assert_array_equal(held.time, np.concatenate([p.time for p in all_parts])[-count:])
        numbers = np.arange(sum(map(len, all_parts)))[-count:]
        for name, values in held.channels.items():
            known = np.concatenate([np.full(len(p), name in p) for p in all_parts])[-count:]
            np.testing.assert_array_equal(values, np.where(known, numbers, np.nan))
        warm = held.channels.get("temperature", np.full(count, np.nan))
        if np.isfinite(warm).any():
            np.testing.assert_allclose(window.temperature, np.nanmean(warm))
        else:
            assert np.isnan(window.temperature)
        tail = window.recording(part.time[-1] - 0.1)
        np.testing.assert_array_equal(tail.time, held.time[held.time >= part.time[-1] - 0.1])


@given(sizes=parts)
def test_a_recording_of_it_stays_as_it_is_when_samples_follow(sizes):
    window, seen = SlidingWindow(1.0), []
    for part in recordings(sizes):
        window.append(part)
        held = window.recording()
        seen.append((held, held.time.copy(), {name: values.copy() for name, values in held.channels.items()}))
    for held, time, channels in seen:
        np.testing.assert_array_equal(held.time, time)
        for name, values in channels.items():
            np.testing.assert_array_equal(held[name], values)


def test_its_memory_does_not_grow():
    window, seen = SlidingWindow(1.0), []
    for part in recordings([(10, 0.0, {"torque"})] * 2000):
        window.append(part)
        seen.append(weakref.ref(part))
    del part
    assert len(window.recording()) <= 111
    assert sum(kept() is not None for kept in seen) <= 12


def test_samples_that_come_one_by_one_cover_time_too():
    window = SlidingWindow(1.0)
    for part in recordings([(1, 0.0, {"torque"})] * 300):
        window.append(part)
    assert len(window) in (100, 101)
    np.testing.assert_allclose(window.end - window.start, 1.0, atol=1.5 * PERIOD)


@given(sizes=parts, length=st.floats(0.05, 5.0), instant=st.floats(0.0, 1.0))
def test_a_window_since_an_instant_holds_the_samples_from_there_on_and_goes_on(sizes, length, instant):
    window, later = SlidingWindow(length), Recording(np.array([1e4]), {"link_position": np.zeros(1)})
    for part in recordings(sizes):
        window.append(part)
    whole = window.recording()
    since = whole.time[0] + instant * (whole.time[-1] - whole.time[0])
    kept = window.since(since)
    wanted, found = whole.time[whole.time >= since], kept.recording().time
    np.testing.assert_array_equal(found, wanted[len(wanted) - len(found) :])
    assert len(wanted) - len(found) <= 1, "the step before the first part counts as one of its own"
    assert kept.end == window.end
    kept.append(later)
    assert kept.end == 1e4
