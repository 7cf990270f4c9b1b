"""Threads of which one has the lead."""

import threading

import pytest

from joint_id_ros.relay import Relay

from .slow_worker import PATIENCE_S, until


class Relayed:
    """Three threads; one that gets the lead works until its event is set, and notes whether it leads then."""

    def __init__(self):
        self.relay = Relay(3, self.run, "relay")
        self.begun, self.led, self.alone = [], {}, []

    def run(self, end):
        self.begun.append(end)
        assert end.wait(PATIENCE_S)
        self.led[end] = self.relay.leads
        if self.relay.leads:
            self.relay.wait_for_others()
            self.alone.append(end)

    def hand_over(self):
        """Let another thread lead; return the event that ends its work, None if no thread waits."""
        end = threading.Event()
        if not self.relay.hand_over(end):
            return None
        until(lambda: end in self.begun)
        return end


@pytest.fixture
def relayed():
    found = Relayed()
    yield found
    for end in found.begun:
        end.set()
    found.relay.stop(PATIENCE_S)
    assert not any(thread.is_alive() for thread in found.relay._threads)


def test_only_the_newest_leads_and_who_returns_can_lead_again(relayed):
    first, second, third = (relayed.hand_over() for _ in range(3))
    assert relayed.hand_over() is None
    first.set()
    until(lambda: relayed.hand_over() is not None)
    fourth = relayed.begun[-1]
    for end in (third, fourth):
        end.set()
    until(lambda: len(relayed.led) == 3)
    assert relayed.led == {first: False, third: False, fourth: True}
    assert not relayed.alone  # the second one works
    second.set()
    until(lambda: relayed.alone == [fourth])


def test_no_thread_is_started_or_ended_when_the_lead_changes(relayed):
    before = {*threading.enumerate()}
    for _ in range(5):
        end = relayed.hand_over()
        end.set()
        until(lambda: relayed.alone[-1:] == [end])  # noqa: B023
        assert {*threading.enumerate()} == before


def test_who_does_something_that_takes_long_delays_the_end_no_longer_than_it_may(relayed):
    relayed.hand_over()
    relayed.relay.stop(0.1)
    alive = [thread for thread in relayed.relay._threads if thread.is_alive()]
    assert len(alive) == 1
