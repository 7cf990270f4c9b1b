"""Joining by stamps: what comes out is what went in, in order, whatever the arrival."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.alignment.joining import COMES_AGAIN, Joiner, StampOrder
from joint_id_core.errors import JointIdError

MS = 10**6
TOPICS = ("links", "motors", "volts")


class FakeClock:
    """Real time that follows the arrival of messages."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def drained(joiner, messages):
    out = []
    for topic, stamp in messages:
        out += joiner.add(topic, stamp, f"{topic}@{stamp}")
    return out


@settings(deadline=None)
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


@settings(deadline=None)
@given(gone=st.integers(1, 60), skew=st.integers(0, 20))
def test_a_topic_that_falls_silent_holds_up_the_others_for_the_wait_and_no_sample_is_lost(gone, skew):
    wait = 40 * MS
    patience = int(COMES_AGAIN) * wait
    stamps = [k * MS for k in range(1, 401)]
    arrival = sorted(
        [("links", s, s) for s in stamps] + [("motors", s, s + skew * MS) for s in stamps[:gone]], key=lambda m: m[2]
    )
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), wait / 1e9, clock)
    out = []
    for topic, stamp, arrived in arrival:
        clock.now = arrived / 1e9
        out += joiner.add(topic, stamp, topic)
        if topic == "links" and out:
            assert out[-1][0] >= stamp - patience - skew * MS
    assert [stamp for stamp, _ in out] == stamps[: len(out)]
    clock.now += patience / 1e9
    out += joiner.release(idle=True)
    assert len(out) == 400  # the silent topic is no longer awaited
    assert [("motors" in parts) for _, parts in out] == [k < gone for k in range(400)]


def test_messages_that_the_middleware_lost_and_sends_again_after_3_s_are_joined():
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 1.0, clock)
    stamps = [k * 2 * MS for k in range(1, 1501)]
    # A bag of 3 s is played within an instant; one message of 'motors' is lost, and what came after it is held back.
    out = drained(joiner, [(t, s) for s in stamps for t in ("links", "motors") if t == "links" or s < 1000 * MS])
    for _ in range(30):
        clock.now += 0.1
        out += joiner.release(idle=True)
    assert joiner.waiting
    out += drained(joiner, [("motors", s) for s in stamps if s >= 1000 * MS])
    assert [stamp for stamp, _ in out] == stamps
    assert all(len(parts) == 2 for _, parts in out)
    assert not joiner.waiting


def test_a_topic_nobody_publishes_delays_only_the_start():
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 0.05, clock)
    released = []
    for k in range(1, 100):
        clock.now = k * 0.002
        released.append(len(joiner.add("links", k * 2 * MS, "")))
    first = released.index(next(n for n in released if n))
    assert first == 25  # 50 ms of samples
    assert released[first] == 26 and set(released[first + 1 :]) == {1}


def test_a_sample_that_comes_after_its_stamp_was_released_is_refused_by_name():
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 0.01, clock)
    for k in range(1, 100):
        clock.now = k * 0.001
        joiner.add("links", k * MS, "")
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


def test_what_waits_at_the_end_of_a_run_comes_out_when_the_next_one_begins():
    joiner = Joiner(("links", "motors"), 10.0)
    run = [("links", k * MS) for k in range(2000)]
    assert drained(joiner, run) == []
    assert [stamp for stamp, _ in drained(joiner, [("links", 1 * MS)])] == [stamp for _, stamp in run]


@settings(deadline=None)
@given(st.integers(1, 400))
def test_a_bag_played_fast_may_bring_one_topic_long_before_the_other(ahead):
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 0.1, clock)
    stamps = [k * 2 * MS for k in range(1, 401)]
    out = drained(joiner, [("links", s) for s in stamps[:ahead]])  # seconds of stamps at one moment
    clock.now = 0.05
    out += drained(joiner, [("motors", s) for s in stamps] + [("links", s) for s in stamps[ahead:]])
    assert [stamp for stamp, _ in out] == stamps
    assert all(len(parts) == 2 for _, parts in out)


def test_what_waits_for_a_silent_topic_comes_out_without_another_message():
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 0.1, clock)
    assert drained(joiner, [("links", k * 2 * MS) for k in range(1, 101)]) == []
    clock.now = 0.09
    assert joiner.release(idle=True) == []
    clock.now = 0.1
    assert len(joiner.release(idle=True)) == 100


def test_a_reader_that_was_held_up_still_joins_what_has_arrived_meanwhile():
    clock = FakeClock()
    joiner = Joiner(("links", "motors"), 0.1, clock)
    early = [(t, k * 2 * MS) for k in range(1, 11) for t in ("links", "motors")]
    late = [(t, k * 2 * MS) for k in range(11, 51) for t in ("links", "motors")]
    out = drained(joiner, early)
    clock.now = 5.0
    out += drained(joiner, late)
    assert [len(parts) for _, parts in out] == [2] * 50
