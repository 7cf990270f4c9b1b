"""The thread of the identifier when fits are slower than the samples come."""

import time

import numpy as np
import pytest

from joint_id_ros import presence
from joint_id_ros.presence import GONE_S
from joint_id_ros.sample_queue import KEEP_S, QUEUE_S
from joint_id_ros.worker import gathered_s

from .slow_worker import PERIOD_NS, add, until


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
