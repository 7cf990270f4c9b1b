"""Joining by stamps: what comes out is what went in, in order, whatever the arrival."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.errors import JointIdError
from joint_id_ros.joining import Joiner, StampOrder

MS = 10**6
TOPICS = ("links", "motors", "volts")


def drained(joiner, messages):
    out = []
    for topic, stamp in messages:
        out += joiner.add(topic, stamp, f"{topic}@{stamp}")
    return out


@given(st.data())
def test_topics_that_all_come_are_joined_completely_whatever_their_interleaving(data):
    stamps = [k * 2 * MS for k in range(1, 31)]
    left = {topic: list(stamps) for topic in TOPICS}
    arrival = []
    while any(left.values()):
        topic = data.draw(st.sampled_from([t for t in TOPICS if left[t]]))
        arrival.append((topic, left[topic].pop(0)))
    joined = drained(Joiner(TOPICS, 1.0), arrival)
    assert [stamp for stamp, _ in joined] == stamps
    for stamp, parts in joined:
        assert parts == {topic: f"{topic}@{stamp}" for topic in TOPICS}


@given(gone=st.integers(1, 60), skew=st.integers(0, 20))
def test_a_topic_that_falls_silent_holds_up_the_others_for_the_wait_and_no_sample_is_lost(gone, skew):
    wait = 40 * MS
    stamps = [k * MS for k in range(1, 201)]
    arrival = sorted(
        [("links", s, s) for s in stamps] + [("motors", s, s + skew * MS) for s in stamps[:gone]], key=lambda m: m[2]
    )
    joiner = Joiner(("links", "motors"), wait / 1e9)
    out = []
    for topic, stamp, _ in arrival:
        out += joiner.add(topic, stamp, topic)
        if topic == "links" and out:
            assert out[-1][0] >= stamp - wait
    assert [stamp for stamp, _ in out] == stamps[: len(out)]
    assert len(out) == 200  # the silent topic is no longer awaited
    assert [("motors" in parts) for _, parts in out] == [k < gone for k in range(200)]


def test_a_topic_nobody_publishes_delays_only_the_start():
    joiner = Joiner(("links", "motors"), 0.05)
    released = [len(joiner.add("links", k * 2 * MS, "")) for k in range(1, 100)]
    first = released.index(next(n for n in released if n))
    assert first == 25  # 50 ms of samples
    assert released[first] == 26 and set(released[first + 1 :]) == {1}


def test_a_sample_that_comes_after_its_stamp_was_released_is_refused_by_name():
    joiner = Joiner(("links", "motors"), 0.01)
    drained(joiner, [("links", k * MS) for k in range(1, 100)])
    with pytest.raises(JointIdError, match=r"motors: a sample came 0\.094 s after the others"):
        joiner.add("motors", 5 * MS, "")


@pytest.mark.parametrize(("second", "text"), [(5, "repeats"), (4, "goes back by 0.001 s"), (0, "zero")])
def test_stamps_out_of_order_are_refused_and_forgotten(second, text):
    order = StampOrder()
    assert not order.restarts("links", 5 * MS)
    with pytest.raises(JointIdError, match=f"links: the stamp.*{text}"):
        order.restarts("links", second * MS)
    assert not order.restarts("links", 6 * MS)


def test_a_recording_may_begin_at_zero_and_be_played_again():
    joiner = Joiner(("links",), 1.0)
    run = [("links", k * MS) for k in range(3000)]
    assert [stamp for stamp, _ in drained(joiner, run)] == [stamp for _, stamp in run]
    assert [stamp for stamp, _ in drained(joiner, run[1:])] == [stamp for _, stamp in run[1:]]
