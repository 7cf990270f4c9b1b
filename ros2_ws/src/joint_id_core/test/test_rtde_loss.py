"""Lost samples are told from jumps of the controller's clock."""

import math

import numpy as np
import pytest

from joint_id_core.rtde.loss import LossCounter

from .watched_stream import RATE


def losses(times, arrivals, rate=RATE):
    counter = LossCounter(rate)
    return [counter.count(t, a) for t, a in zip(times, arrivals, strict=True)]


def test_loss_is_counted_by_the_time_stamps_however_late_samples_arrive():
    rng = np.random.default_rng(1)
    kept = np.flatnonzero(rng.random(20_000) > 0.02)
    times = 5000.0 + kept / RATE
    arrivals = np.maximum.accumulate(70.0 + kept / RATE + rng.exponential(0.001, len(kept)))
    stall = (kept > 8000) & (kept < 9000)
    arrivals[stall] = arrivals[stall][-1]  # two seconds of samples at once
    counted = losses(times, arrivals)
    assert counted == [0, *(np.diff(kept) - 1).tolist()]
    assert sum(counted) > 200


def test_a_gap_is_a_loss_when_time_has_passed_and_a_jump_when_it_has_not():
    assert losses([10.0, 10.002, 13.002, 13.004], [0.0, 0.002, 3.002, 3.004]) == [0, 0, 1499, 0]
    assert losses([10.0, 10.002, 13.002, 13.004], [0.0, 0.002, 0.004, 0.006]) == [0, 0, None, 0]
    assert losses([10.0, 10.002, 4.0, 4.002, 4.008], [0.0, 0.002, 0.004, 0.006, 0.012]) == [0, 0, None, 0, 2]


def test_a_sample_without_a_time_has_still_arrived():
    assert losses([10.0, 0.0, math.nan, 10.006], [0.0, 0.002, 0.004, 0.006]) == [0, 0, 0, 0]
    assert losses([10.0, math.inf, 10.010], [0.0, 0.002, 0.010]) == [0, 0, 3]
    assert losses([10.0, 10.0, 10.002], [0.0, 0.001, 0.002]) == [0, 0, 0]


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_drift_apart_for_hours_make_no_jump_and_hide_none(drift):
    seconds = np.arange(0.0, 8.0 * 3600.0, 1.0)
    times = 100.0 + seconds * (1.0 + drift)
    times[-1] += 1.5  # which must not be lost in 3 s of drift
    assert losses(times, seconds, rate=1.0) == [*[0] * (len(seconds) - 1), None]
