"""The threads of the identifier while the fit of one joint takes long."""

import threading
import time
from dataclasses import replace

import pytest

from joint_id_ros.presence import GONE_S
from joint_id_ros.sample_queue import QUEUE_S
from joint_id_ros.worker import threads_for

from .slow_worker import PERIOD_NS, add, until


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


def threads():
    """Those of the identifier."""
    return {thread for thread in threading.enumerate() if thread.name in ("identifier", "checks of windows")}


def test_all_threads_are_there_before_a_fit_takes_long_and_end_with_the_worker(working):
    before = threads()
    worker, _, made = stuck_in_a_fit(working)
    add(worker, 10, 210, ("stuck", "a"))
    until(lambda: worker.wake() or sum(map(len, made["a"].batches)) == 210)
    assert threads() == before and len(before) == threads_for(0) + 1
    made["stuck"].gate.set()
    until(lambda: worker.idle)
    assert threads() == before
    worker.stop()
    until(lambda: not before & threads())


def test_there_are_two_threads_more_than_cores_or_joints(monkeypatch):
    for cores, joints, threads in ((2, 6, 4), (16, 6, 8), (16, 1, 3), (16, 0, 9), (None, 6, 3)):
        monkeypatch.setattr("os.cpu_count", lambda cores=cores: cores)
        assert threads_for(joints) == threads


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
