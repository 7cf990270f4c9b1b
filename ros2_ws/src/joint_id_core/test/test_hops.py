"""When an estimate is due, for batches of samples that end early or late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.online.hops import Hops
from joint_id_core.online.window import SlidingWindow

PERIOD = 0.002


def ends_of_hops(hop_s, ends, first):
    """Instants of the batches that end a hop; `ends` are the numbers of the samples after each batch."""
    hops, recent, found, begin = Hops(hop_s), SlidingWindow(2.0), [], 0
    hops.begin(first)
    for end in ends:
        recent.append(Recording(PERIOD * np.arange(begin, end), {"torque": np.zeros(end - begin)}))
        begin = end
        if hops.ends(recent):
            found.append(recent.end)
    return np.array(found)


@given(jitter=st.lists(st.integers(-1, 2), min_size=60, max_size=60), hop=st.sampled_from([10, 25, 50]))
def test_batches_that_end_some_samples_early_or_late_leave_no_hop_out(jitter, hop):
    ends = [hop * (k + 1) + late for k, late in enumerate(jitter)]
    found = ends_of_hops(hop * PERIOD, ends, hop * PERIOD)
    assert len(found) >= len(ends) - 1


@given(sizes=st.lists(st.integers(1, 60), min_size=50, max_size=80))
def test_the_mean_time_between_estimates_is_never_shorter_than_a_hop(sizes):
    ends = np.cumsum(sizes).tolist()
    found = ends_of_hops(0.02, ends, 0.1)
    assert len(found) - 1 <= (ends[-1] * PERIOD - 0.1) / 0.02 + 1.0
    assert np.all(np.diff(found) > 0.0)


def test_the_first_one_ends_with_the_window_not_before():
    found = ends_of_hops(0.5, range(1, 1500), 2.0)
    assert found[0] == pytest.approx(2.0 - PERIOD)
    np.testing.assert_allclose(np.diff(found), 0.5, atol=0.006)


def test_a_batch_that_holds_several_hops_gives_one_estimate_and_they_go_on_from_there():
    found = ends_of_hops(0.02, [10, 20, 100, 105, 110, 120], 0.02)
    np.testing.assert_allclose(found, PERIOD * (np.array([10, 20, 100, 110, 120]) - 1))
