"""The thread that does what is to be done beside the recursion."""

import threading

import pytest

from joint_id_core.online.check_thread import CheckThread

PATIENCE_S = 60.0


@pytest.fixture
def check():
    thread = CheckThread()
    yield thread
    thread.stop()


def test_a_check_in_a_thread_gives_its_result_or_its_error(check):
    assert check(lambda: 1).result(PATIENCE_S) == 1
    with pytest.raises(ZeroDivisionError):
        check(lambda: 1 / 0).result(PATIENCE_S)


def test_checks_are_done_one_after_the_other_in_the_thread_that_was_there_before(check):
    slow, before = threading.Event(), threading.active_count()
    first, *others = [check(job) for job in (slow.wait, *[threading.get_ident] * 5)]
    assert threading.active_count() == before
    assert not any(check.done() for check in (first, *others))
    slow.set()
    assert len({check.result(PATIENCE_S) for check in others}) == 1
    assert first.done() and threading.active_count() == before


def test_the_checks_of_two_robots_do_not_run_at_the_same_time(check):
    other, begun, slow, quick = CheckThread(), threading.Event(), threading.Event(), threading.Event()
    check(lambda: begun.set() or slow.wait())
    assert begun.wait(PATIENCE_S)
    last = other(quick.set)
    assert not quick.wait(0.1)
    slow.set()
    last.result(PATIENCE_S)
    other.stop()


def test_the_end_leaves_checks_that_wait_undone():
    check, begun, slow, done = CheckThread(), threading.Event(), threading.Event(), []
    running = check(lambda: begun.set() or slow.wait())
    waiting = check(lambda: done.append(1))
    assert begun.wait(PATIENCE_S)
    check.stop()
    slow.set()
    assert running.result(PATIENCE_S)
    check._thread.join(PATIENCE_S)
    assert not check._thread.is_alive() and not done and not waiting.done()
