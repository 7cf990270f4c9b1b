"""The thread of the identifier when fits are slower than the samples come."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_ros import presence
from joint_id_ros.callbacks import Callbacks
from joint_id_ros.presence import GONE_S
from joint_id_ros.raw_messages import RawMessage, Table
from joint_id_ros.sample_queue import KEEP_S, QUEUE_S
from joint_id_ros.worker import Worker, gathered_s

PERIOD_NS = 10_000_000
MODEL = build("rigid_joint")
PATIENCE_S = 60.0


class Slow:
    """An identifier whose updates wait until they may go on."""

    def __init__(self, gate, finished):
        self.gate, self.finish, self.begun, self.batches = gate, finished, threading.Event(), []
        self.model = MODEL

    def update(self, samples):
        self.begun.set()
        assert self.gate.wait(PATIENCE_S)
        self.batches.append(samples)
        return unusable(MODEL, "slow", UnusableError(Status.NO_MOTION, "it rests"), samples)


@pytest.fixture
def working(request):
    """A worker with slow identifiers, and all that it calls back; the test's parameter says whether for a recording."""
    gate, told, made = threading.Event(), [], {}
    stuck = threading.Event()

    def make(joint, samples):
        made[joint] = Slow(stuck if joint == "stuck" else gate, lambda: told.append(("finished", joint)))
        return made[joint]

    callbacks = Callbacks(
        lambda joint, estimate, origin_ns: told.append(("estimated", joint)),
        lambda: told.append(("published", "")),
        lambda joint: told.append(("gone", joint)),
        lambda joint: told.append(("silent", joint)),
        lambda kind, text: told.append((kind, text)),
    )
    worker = Worker(make, (), (), callbacks, hop_s=0.5, recorded=getattr(request, "param", False))
    yield worker, gate, told, made
    gate.set()
    stuck.set()
    worker.stop()


def add(worker, first, last, names=("a",)):
    """Add samples `first` to before `last`."""
    table = Table(tuple(names), {"link_position": np.zeros((last - first, len(names)))})
    for k in range(first, last):
        worker.add(RawMessage(10**12 + k * PERIOD_NS, table, k - first))


def until(condition):
    """Wait for a condition."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def two_runs(working):
    """The worker and the identifiers of two runs, of 500 and 100 samples; all but the first sample waits meanwhile."""
    worker, gate, _, made = working
    add(worker, 0, 1)
    until(lambda: "a" in made and made["a"].begun.is_set())
    first = made["a"]
    add(worker, 1, 500)
    worker.restart()
    add(worker, 0, 100)
    gate.set()
    until(lambda: worker.idle)
    return worker, first, made["a"]


def test_no_more_than_some_seconds_wait_and_the_newest_stay(working):
    worker, gate, told, made = working
    add(worker, 0, 1)
    until(lambda: "a" in made and made["a"].begun.is_set())  # with the first sample; all others wait
    add(worker, 1, 3000)  # 30 s
    assert worker.backlog * PERIOD_NS <= QUEUE_S * 1e9
    assert worker.left_out + worker.backlog == 2999
    assert any(kind == "lost by this computer" and "left out" in text for kind, text in told)
    assert worker.waiting == ["a"] and worker.lag_s() == pytest.approx(29.99)
    gate.set()
    until(lambda: worker.idle)
    assert worker.lag_s() == pytest.approx(29.99)  # the worst since the last question
    assert worker.lag_s() == 0.0 and worker.waiting == []
    kept = made["a"].batches[1].time
    assert kept[-1] == pytest.approx(29.99) and kept[-1] - kept[0] >= KEEP_S
    assert worker.missed == round(len(kept) * PERIOD_NS * 1e-9 / 0.5) - 1


@pytest.mark.parametrize("working", [True], indirect=True)
def test_recorded_samples_wait_and_go_into_one_estimate_each_time_that_one_is_due(working):
    worker, gate, told, made = working
    add(worker, 0, 1)
    until(lambda: "a" in made and made["a"].begun.is_set())
    assert not worker.full
    add(worker, 1, 3000)  # 30 s, more than is ever read while the worker is full
    assert worker.full and worker.waiting == [] and worker.lag_s() == 0.0
    gate.set()
    until(lambda: worker.idle)
    assert not worker.full
    batches = [batch.time for batch in made["a"].batches]
    np.testing.assert_allclose(np.concatenate(batches), np.arange(3000) * PERIOD_NS * 1e-9)
    assert max(time[-1] - time[0] for time in batches) <= gathered_s(0.5) + 1e-9
    assert worker.missed == worker.left_out == 0
    assert {kind for kind, _ in told} == {"estimated", "published", "finished"}
    time.sleep(GONE_S + 0.5)
    assert ("gone", "a") not in told  # what was recorded has an end


@pytest.mark.parametrize("working", [True], indirect=True)
def test_a_new_run_of_a_recording_begins_after_all_of_the_last_one(working):
    worker, first, second = two_runs(working)
    assert sum(len(batch) for batch in first.batches) == 500
    assert second is not first and sum(len(batch) for batch in second.batches) == 100
    assert worker.left_out == 0


def test_who_keeps_up_misses_nothing(working):
    worker, gate, told, _ = working
    gate.set()
    for k in range(0, 200, 40):
        add(worker, k, k + 40)
        until(lambda: worker.idle)
    assert worker.missed == worker.left_out == 0
    assert {kind for kind, _ in told} == {"estimated", "published", "finished"}


def test_estimates_that_come_together_are_published_together_before_what_they_do_not_need(working):
    worker, gate, told, _ = working
    gate.set()
    add(worker, 0, 10, ("a", "b"))
    until(lambda: worker.idle)
    batches = len(told) // 5  # the thread may have looked before the last sample was there
    one = [("estimated", "a"), ("estimated", "b"), ("published", ""), ("finished", "a"), ("finished", "b")]
    assert told == batches * one


def stuck_in_a_fit(working):
    """The worker while a fit of joint "stuck" takes long and "a" goes on, and the identifiers."""
    worker, gate, told, made = working
    gate.set()
    add(worker, 0, 10, ("stuck", "a"))
    until(lambda: "stuck" in made and made["stuck"].begun.is_set())
    until(lambda: worker.wake() or ("estimated", "a") in told)
    return worker, told, made


def test_a_fit_that_takes_long_holds_up_no_other_joint(working):
    worker, told, made = stuck_in_a_fit(working)
    for k in range(10, 210, 20):
        add(worker, k, k + 20, ("stuck", "a"))
        until(lambda: worker.wake() or sum(map(len, made["a"].batches)) == k + 20)  # noqa: B023
    until(lambda: told[-1] == ("finished", "a"))
    assert ("published", "") in told and ("estimated", "stuck") not in told
    assert not made["stuck"].batches and worker.waiting == ["stuck"]
    assert worker.lag_s() > 1.9 and worker.busy_s > 0.0 and not worker.idle
    made["stuck"].gate.set()
    until(lambda: worker.idle)
    first, *later = made["stuck"].batches
    assert sum(map(len, later)) == 210 - len(first) and len(later) == 1  # what has waited is one update
    assert worker.missed == round(len(later[0]) * PERIOD_NS * 1e-9 / 0.5) - 1 and worker.left_out == 0
    assert told.count(("estimated", "stuck")) == 2 and ("published", "") in told[told.index(("estimated", "stuck")) :]


def test_of_a_joint_that_waits_for_its_fit_the_newest_seconds_are_kept(working):
    worker, told, made = stuck_in_a_fit(working)
    for k in range(10, 3010, 300):
        add(worker, k, k + 300, ("stuck", "a"))
        until(lambda: worker.wake() or sum(map(len, made["a"].batches)) == k + 300)  # noqa: B023
    made["stuck"].gate.set()
    until(lambda: worker.idle)
    _, kept = made["stuck"].batches
    assert kept.time[-1] == pytest.approx(30.09) and kept.duration == pytest.approx(QUEUE_S, abs=0.02)
    assert worker.left_out > 1900 and sum(map(len, made["stuck"].batches)) + worker.left_out == 3010
    assert next(text for kind, text in told if kind == "lost by this computer").startswith("joint stuck: ")


def test_what_a_fit_finds_of_a_joint_that_is_gone_meanwhile_is_not_told(working):
    worker, told, made = stuck_in_a_fit(working)
    first, last = made["stuck"], round((GONE_S + 1.0) * 1e9 / PERIOD_NS)
    add(worker, 10, last, ("a",))
    until(lambda: worker.wake() or ("gone", "stuck") in told)
    first.gate.set()
    until(lambda: len(first.batches) == 1)
    add(worker, last, last + 10, ("stuck", "a"))
    until(lambda: worker.wake() or (made["stuck"] is not first and made["stuck"].batches))
    until(lambda: worker.idle)
    assert told.count(("estimated", "stuck")) == len(made["stuck"].batches)


def test_what_a_fit_finds_of_an_earlier_run_is_not_told(working):
    worker, told, made = stuck_in_a_fit(working)
    first = made["stuck"]
    worker.restart()
    add(worker, 0, 10, ("stuck", "a"))
    # On two cores the second fit of the joint waits for the first one, as do then the other joints.
    until(lambda: worker.wake() or made["stuck"] is not first)
    first.gate.set()
    until(lambda: worker.wake() or worker.idle)
    assert len(first.batches) == 1 and told.count(("estimated", "stuck")) == len(made["stuck"].batches)


@pytest.mark.parametrize("working", [True], indirect=True)
def test_recorded_samples_wait_until_all_joints_have_taken_those_before(working):
    worker, _, made = stuck_in_a_fit(working)
    add(worker, 10, 210, ("stuck", "a"))
    for _ in range(10):
        worker.wake()
        time.sleep(0.02)
    assert len(made["a"].batches) == 1 and not made["stuck"].batches
    made["stuck"].gate.set()
    until(lambda: worker.idle)
    assert [sum(map(len, made[joint].batches)) for joint in ("a", "stuck")] == [210, 210]
    assert worker.left_out == worker.missed == 0


def test_an_error_while_an_estimate_is_told_ends_nothing(working):
    worker, gate, told, made = working
    gate.set()
    worker._callbacks = replace(worker._callbacks, estimated=lambda *_: 1 / 0)
    add(worker, 0, 10)
    until(lambda: any(kind == "internal error" and "ZeroDivisionError" in text for kind, text in told))
    until(lambda: worker.idle)
    add(worker, 10, 20)
    until(lambda: worker.idle)
    assert sum(map(len, made["a"].batches)) == 20


def test_a_new_run_forgets_what_waits(working):
    worker, first, second = two_runs(working)
    assert second is not first
    assert [len(batch) for batch in second.batches] == [100]
    assert worker.left_out == 0


def test_a_joint_that_is_not_named_any_more_is_given_back_once(working):
    worker, gate, told, made = working
    gate.set()
    add(worker, 0, 10, ("a", "b"))
    until(lambda: worker.idle)
    first = made["b"]
    add(worker, 10, 200)
    until(lambda: worker.idle)
    assert ("gone", "b") not in told  # for less than GONE_S
    last = round((GONE_S + 1.0) * 1e9 / PERIOD_NS)
    add(worker, 200, last)
    until(lambda: worker.idle)
    add(worker, last, last + 300)
    until(lambda: worker.idle)
    assert told.count(("gone", "b")) == 1
    add(worker, last + 300, last + 310, ("a", "b"))
    until(lambda: worker.idle)
    assert made["b"] is not first


def identified(working):
    """The worker once it has taken samples of two joints, what it told, and the first identifier of one of them."""
    worker, gate, told, made = working
    gate.set()
    add(worker, 0, 10, ("a", "b"))
    until(lambda: worker.idle)
    return worker, told, made, made["a"]


def test_all_joints_are_silent_when_no_samples_come_and_go_on_when_they_return(working):
    worker, told, made, first = identified(working)
    until(lambda: {("silent", "a"), ("silent", "b")} <= {*told})
    assert ("no samples", f"no joint_samples for {GONE_S:.0f} s: until they come again, no estimate of a, b") in told
    add(worker, 10, 20, ("a", "b"))
    until(lambda: told.count(("estimated", "a")) > 1)
    assert made["a"] is first and not [kind for kind, _ in told if kind == "gone"]
    assert [kind for kind, _ in told].count("silent") == 2


def test_after_a_long_pause_all_joints_begin_with_what_is_known(working, monkeypatch):
    monkeypatch.setattr(presence, "PAUSE_S", GONE_S + 0.2)
    worker, told, made, first = identified(working)
    until(lambda: {("gone", "a"), ("gone", "b")} <= {*told})
    add(worker, 10, 20, ("a", "b"))
    until(lambda: made["a"] is not first)
    assert [kind for kind, _ in told].count("gone") == 2
