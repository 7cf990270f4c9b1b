"""Stamps have the steps of the controller's clock, or there is none."""

import itertools
import math

import pytest

from joint_id_core.rtde.client import Sample
from joint_id_core.rtde.stamping import Stamper

NANO = 10**9
EPOCH_NS = 1_700_000_000 * NANO
PERIOD_S, PERIOD_NS = 0.002, 2_000_000
DELAY_NS = 100_000
SLEW, ROUNDING_NS = 200e-6, 2  # of the controller clock


@pytest.fixture
def events():
    return []


@pytest.fixture
def stamper(events):
    return Stamper(lambda *event: events.append(event))


def sample(k, arrived_s=None, timestamp=None):
    """Sample k, taken k periods after the epoch; it arrives after a short delay or when it is said."""
    taken_s = k * PERIOD_S
    received = EPOCH_NS + round((taken_s if arrived_s is None else arrived_s) * NANO) + DELAY_NS
    return Sample(received, {"timestamp": 50.0 + taken_s if timestamp is None else timestamp})


def one_by_one(stamper, samples):
    return [stamper.stamp(s, s) for s in samples]


def expected(k):
    return EPOCH_NS + k * PERIOD_NS + DELAY_NS


def test_samples_that_come_in_time_are_stamped_with_their_arrival(stamper, events):
    assert one_by_one(stamper, map(sample, range(1000))) == [expected(k) for k in range(1000)]
    assert not events


@pytest.mark.parametrize("waited_s", [0.05, 0.4])
def test_first_samples_that_waited_for_their_reader_are_stamped_as_if_they_had_not(stamper, events, waited_s):
    first = [sample(k, waited_s) for k in range(round(waited_s / PERIOD_S) + 1)]
    stamps = [stamper.stamp(s, first[-1]) for s in first]
    stamps += one_by_one(stamper, (sample(k) for k in range(len(first), 500)))
    bound_ns = SLEW * waited_s * NANO + ROUNDING_NS  # the others look late, and the clock follows them that far
    assert all(abs(stamp - expected(k)) <= bound_ns for k, stamp in enumerate(stamps))
    assert not events


@pytest.mark.parametrize("last", [0.0, math.nan])
def test_a_bad_time_of_the_newest_sample_spoils_nothing(stamper, last):
    assert stamper.stamp(sample(0), sample(1, timestamp=last)) is not None
    assert all(one_by_one(stamper, map(sample, range(2, 100))))


def test_after_a_first_sample_that_was_late_for_itself_none_is_stamped_until_the_clock_is_right(stamper):
    late_s = 0.3
    stamps = one_by_one(stamper, [sample(0, late_s), *map(sample, range(1, 1000))])
    given = [(k, stamp) for k, stamp in enumerate(stamps) if stamp is not None]
    without = [k for k, stamp in enumerate(stamps) if stamp is None]
    assert without == list(range(1, 1 + len(without)))
    assert 90 <= len(without) <= late_s / PERIOD_S
    for (k, a), (n, b) in itertools.pairwise(given[1:]):
        assert abs(b - a - (n - k) * PERIOD_NS) <= SLEW * PERIOD_NS + ROUNDING_NS
    assert given[1][1] > given[0][1]


def test_a_restarted_robot_goes_on_after_a_gap(stamper, events):
    before = one_by_one(stamper, map(sample, range(100)))
    stamper.new_connection()
    after = one_by_one(stamper, (sample(k, timestamp=1.0 + k * PERIOD_S) for k in range(1000, 1100)))
    assert before + after == [expected(k) for k in (*range(100), *range(1000, 1100))]
    assert not events
