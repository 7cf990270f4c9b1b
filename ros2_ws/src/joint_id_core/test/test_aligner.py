"""Whatever the raw topics bring, the samples of all joints at one instant come out with the stamp they came with."""

from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.alignment.aligner import Aligner, Columns
from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.errors import JointIdError

from .examples import TIMES

PERIOD_NS = 2_000_000
BEGIN = 1_700_000_000 * 10**9
INPUTS = InputOptions(effort_source="current", join_wait_s=0.0)
DAY_NS = 86_400 * 10**9


def columns(joints, **channels):
    return Columns(tuple(joints), {name: np.array(values) for name, values in channels.items()})


class Sample(NamedTuple):
    """All joints at one instant."""

    instant_ns: int
    joints: list
    channels: dict


def one_by_one(batches):
    return [
        Sample(instant_ns, batch.joints, {name: values[k] for name, values in batch.channels.items()})
        for batch in batches
        for k, instant_ns in enumerate(batch.instants_ns)
    ]


def run(aligner, begin, count, joints=("a", "b"), batch=7):
    """Give a good stream, in batches of this many messages."""
    out = []
    for k in range(count):
        values = np.sin(0.01 * k + np.arange(len(joints)))
        aligner.join("link_states", begin + k * PERIOD_NS, columns(joints, link_position=values))
        if k % batch == 0:
            out += one_by_one(aligner.align())
    return out + one_by_one(aligner.align())


def test_joints_of_several_topics_share_one_row():
    now = 0.0
    aligner = Aligner(InputOptions(effort_source="current", join_wait_s=0.1), clock=lambda: now)
    out = []
    for k in range(400):
        now = 0.002 * k
        stamp = BEGIN + k * PERIOD_NS
        aligner.join("motor_states", stamp, columns("ba", motor_position=[2.0 * k, 1.0 * k]))
        aligner.join("link_states", stamp, columns("a", link_position=[0.1 * k]))
        out += one_by_one(aligner.align())
    full = [s for s in out if "motor_position" in s.channels]
    assert full and all(list(s.joints) == ["b", "a"] for s in full)
    k = (full[-1].instant_ns - BEGIN) // PERIOD_NS
    np.testing.assert_array_equal(full[-1].channels["motor_position"], [2.0 * k, 1.0 * k])
    np.testing.assert_array_equal(full[-1].channels["link_position"], [np.nan, 0.1 * k])


@pytest.mark.parametrize("jump_ns", [-50 * 10**9, 2 * DAY_NS])
def test_a_jump_of_the_stamps_begins_a_new_run_that_keeps_every_nanosecond(jump_ns):
    aligner = Aligner(INPUTS)
    odd = 12_345_677  # not a multiple of what a double can hold at this distance
    out = run(aligner, BEGIN, 400) + run(aligner, BEGIN + jump_ns + odd, 400)
    later = [s.instant_ns for s in out if abs(s.instant_ns - BEGIN) > 10**10]
    assert later == [BEGIN + jump_ns + odd + k * PERIOD_NS for k in range(len(later))] and len(later) > 200
    assert sum(abs(s.instant_ns - BEGIN) < 10**10 for s in out) == 400  # what waited in the filter is not lost
    assert any("restarted" in text for text in aligner.filter.events)


def test_stamps_that_begin_at_zero_by_mistake_cost_no_digits_of_the_true_ones():
    aligner = Aligner(INPUTS)
    aligner.join("link_states", 0, columns("a", link_position=[0.0]))
    out = run(aligner, BEGIN + 1, 400, "a")
    assert [s.instant_ns for s in out][-200:] == [BEGIN + 1 + k * PERIOD_NS for k in range(400)][: len(out) - 1][-200:]


def test_a_stray_message_of_another_topic_far_ahead_costs_nothing():
    aligner = Aligner(INPUTS)
    aligner.join("motor_states", BEGIN + DAY_NS // 2, columns("a", motor_position=[0.0]))
    aligner.align()
    out = run(aligner, BEGIN, 400)
    stamps = [s.instant_ns for s in out if s.instant_ns < BEGIN + DAY_NS // 4]
    assert stamps == [BEGIN + k * PERIOD_NS for k in range(len(stamps))] and len(stamps) > 200


GOOD = BEGIN + 3 * DAY_NS  # begin of the good messages: far from the stamps of all others


@settings(deadline=None, max_examples=15 * TIMES)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["link_states", "motor_states"]),
            st.integers(0, 2**31 * 10**9).filter(lambda ns: abs(ns - GOOD) > 10**10)
            | st.integers(BEGIN - 10**10, BEGIN + 10**10),
            st.lists(st.sampled_from("abc"), min_size=1, unique=True),
            st.floats(-1e9, 1e9) | st.just(np.nan),
        ),
        max_size=30,
    )
)
def test_after_any_messages_good_ones_come_out_as_they_came_in(messages):
    aligner = Aligner(INPUTS)
    for topic, stamp, joints, value in messages:
        name = topic.replace("states", "position")
        with suppress(JointIdError):
            aligner.join(topic, stamp, columns(joints, **{name: np.full(len(joints), value)}))
    out = [s for s in run(aligner, GOOD, 600) if GOOD <= s.instant_ns <= GOOD + 600 * PERIOD_NS]
    stamps = [s.instant_ns for s in out]
    assert stamps == [GOOD + k * PERIOD_NS for k in range(len(stamps))] and len(stamps) > 200
    last = out[-1].channels["link_position"]
    k = len(stamps) - 1
    where = [list(out[-1].joints).index(j) for j in "ab"]
    np.testing.assert_array_equal(last[where], np.sin(0.01 * k + np.arange(2)))
