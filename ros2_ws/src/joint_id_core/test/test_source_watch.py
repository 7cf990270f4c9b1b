"""What a subscriber can tell about the publisher of a topic, and who lost a sample."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.alignment.source_watch import CLOCK, HERE, JOINTS, NETWORK, RATE, REPLACED, SOURCE, SourceWatch

MS = 10**6
BEGIN = 10**12
JOINTS_OF_ARM = ("elbow", "wrist")


class Robot:
    """A publisher whose messages a watch sees, with the real time that passes."""

    together = 1  # messages that are read at once

    def __init__(self, period_ms=2, publishers=1):
        self.now_s, self.stamp_ns, self.sequence, self.period_ms = 0.0, BEGIN, 0, period_ms
        self.joints = JOINTS_OF_ARM
        self.watch = SourceWatch("link_states", lambda: self.now_s)
        self.watch.publishers = publishers

    def skip(self, samples, sent=False):
        """Let time pass without a message; `sent`: they were sent and did not come."""
        self.now_s += samples * self.period_ms * 1e-3
        self.stamp_ns += samples * self.period_ms * MS
        self.sequence += samples * sent

    def send(self, samples=1, waited_s=0.0):
        """Send some messages that arrive; whether all were admitted."""
        taken = True
        for first in range(0, samples, self.together):
            messages = []
            for _ in range(min(self.together, samples - first)):
                self.skip(1, sent=True)
                messages.append((self.stamp_ns, self.sequence))
            stamps_ns, sequences = zip(*messages, strict=True)
            if self.together == 1 or not self.watch.usual(stamps_ns, self.joints, sequences, waited_s):
                taken &= all([self.watch.admit(stamp, self.joints, k, waited_s) for stamp, k in messages])
        return taken

    @property
    def told(self):
        """Kinds of what happened so far."""
        return [event.kind for event in self.watch.events]


@pytest.fixture(autouse=True, scope="module", params=[1, 5, 50])
def together(request):
    """Every test holds for messages one by one, and for many that are read together."""
    Robot.together = request.param


def test_what_follows_as_before_is_usual_and_nothing_else():
    robot = Robot()
    robot.send(60)
    stamps, sequences = ([robot.stamp_ns + k * 2 * MS for k in (1, 2, 3)], [robot.sequence + k for k in (1, 2, 3)])
    for odd in (
        ([*stamps[:2], stamps[2] + MS], JOINTS_OF_ARM, sequences),
        (stamps, JOINTS_OF_ARM[:1], sequences),
        (stamps, JOINTS_OF_ARM, [*sequences[:2], sequences[2] + 1]),
        (stamps, JOINTS_OF_ARM, [k + 1 for k in sequences]),
        (stamps, JOINTS_OF_ARM, [None, None, None]),
        ([k + 2 * MS for k in stamps], JOINTS_OF_ARM, sequences),
        ([robot.stamp_ns, *stamps[:2]], JOINTS_OF_ARM, sequences),
    ):
        assert not robot.watch.usual(*odd, 0.0)
    assert robot.watch.usual(stamps, JOINTS_OF_ARM, sequences, 0.25)
    assert robot.watch.slowest_s == 0.25 and not robot.told


def test_a_healthy_stream_is_no_news():
    robot = Robot()
    assert robot.send(5000)
    assert not robot.told and not robot.watch.lost


@given(st.integers(1, 400), st.sampled_from([1, 2, 8, 40]))
def test_samples_that_were_never_sent_are_lost_by_the_source(count, period_ms):
    robot = Robot(period_ms)
    robot.send(60)
    robot.skip(count)
    robot.send(60)
    assert robot.watch.lost == {SOURCE: count}
    assert f"{count} samples lost: its publisher did not send them" in robot.watch.events[0].text
    assert len(robot.told) == 1


@given(st.integers(1, 900))
def test_samples_that_were_sent_and_did_not_come_are_lost_on_the_way(count):
    robot = Robot()
    robot.send(60)
    robot.skip(count, sent=True)
    robot.send(60)
    assert robot.watch.lost == {NETWORK: count}


@pytest.mark.parametrize("before", [True, False])
def test_samples_lost_while_messages_waited_to_be_read_are_lost_by_this_computer(before):
    robot = Robot()
    robot.send(60, waited_s=0.9 if before else 0.0)
    robot.skip(300, sent=True)
    robot.send(1, waited_s=0.0 if before else 0.9)
    assert robot.watch.lost == {HERE: 300}
    assert robot.watch.slowest_s == 0.9


@given(st.sampled_from([(2, 8), (8, 2), (2, 4), (10, 8), (2, 1)]))
def test_another_sampling_rate_is_named_once_and_loses_nothing(periods):
    robot = Robot(periods[0])
    robot.send(100)
    robot.period_ms = periods[1]
    robot.send(100)
    assert robot.told.count(RATE) == 1 and not robot.watch.lost
    assert f"from {1000 / periods[0]:.4g} to {1000 / periods[1]:.4g} Hz" in robot.watch.events[0].text


def test_without_a_steady_rate_no_gap_is_claimed():
    robot = Robot()
    for k in range(500):
        robot.period_ms = 1 + k * k % 7
        robot.send()
    assert not robot.told and not robot.watch.lost


def test_a_clock_that_is_set_ahead_is_told_from_a_pause():
    robot = Robot()
    robot.send(60)
    robot.stamp_ns += 3600 * 1000 * MS
    robot.send(60)
    assert robot.told == [CLOCK] and "jump ahead by 3600 s" in robot.watch.events[0].text
    robot.skip(1800)  # 3.6 s
    robot.send(60)
    assert robot.watch.lost == {SOURCE: 1800}


def test_a_clock_that_is_set_back_is_not_its_business():
    robot = Robot()
    robot.send(60)
    robot.stamp_ns -= 3600 * 1000 * MS
    robot.send(60)
    assert not robot.told and not robot.watch.lost


def test_a_joint_with_another_name_is_named():
    robot = Robot()
    robot.send(60)
    robot.joints = ("elbow", "wrist_1")
    robot.send(60)
    assert robot.told == [JOINTS]
    assert "joint wrist disappeared and joint wrist_1 appeared: has it got another name?" in robot.watch.events[0].text
    robot.joints = JOINTS_OF_ARM
    robot.send(5)  # a few messages are no news
    robot.joints = ("elbow", "wrist_1")
    robot.send(60)
    assert robot.told == [JOINTS]


def test_a_new_publisher_of_the_same_topic_is_named_and_read():
    robot = Robot()
    robot.send(60)
    robot.sequence = 0
    assert robot.send(60)
    assert robot.told == [REPLACED] and not robot.watch.lost


@given(st.integers(1, 10**6), st.integers(1, 10**6), st.floats(0.05, 1.95))
def test_of_two_publishers_the_first_one_is_read(first, second, offset_ms):
    if abs(first - second) < 1500:
        second += 3000
    robot = Robot(publishers=2)
    robot.sequence = first
    robot.send(50)
    for k in range(100):
        other = robot.watch.admit(robot.stamp_ns + int(offset_ms * MS), JOINTS_OF_ARM, second + k)
        assert not other and robot.send()
    assert robot.watch.foreign == 100 and not robot.watch.lost and not robot.told
    robot.now_s += 1.5  # the first one ends
    assert robot.watch.admit(robot.stamp_ns + 1500 * MS, JOINTS_OF_ARM, second + 850)
    assert robot.told[0] == REPLACED


def test_a_second_publisher_is_counted_when_its_first_message_comes():
    robot, asked = Robot(), []
    robot.watch = SourceWatch("link_states", lambda: robot.now_s, count=lambda: asked.append(True) or 2)
    robot.sequence = 3000
    assert robot.send(50) and not asked
    assert not robot.watch.admit(robot.stamp_ns + MS, JOINTS_OF_ARM, 1)
    assert robot.send(50) and len(asked) == 1
    assert robot.watch.foreign == 1 and not robot.watch.lost and not robot.told


EVENTS = st.tuples(
    st.integers(-(2**62), 2**62),
    st.lists(st.sampled_from(["", "a", "b"]), max_size=3),
    st.none() | st.integers(0, 2**63),
    st.floats(-1e9, 1e9),
)


@given(st.lists(EVENTS, max_size=60), st.integers(0, 3))
def test_nothing_that_comes_ends_it(messages, publishers):
    now = iter(range(10**6))
    watch = SourceWatch("link_states", lambda: next(now) * 0.01)
    watch.publishers = publishers
    for message in messages:
        watch.admit(*message)
    assert all(count > 0 for count in watch.lost.values())
    assert all(event.text.startswith("link_states: ") for event in watch.events)
