"""Work in a process of its own gives its result, its error or its death, and can be ended."""

import os
import signal
import time

import pytest

from joint_id_core.errors import JointIdError
from joint_id_ros.child_process import ChildProcess

PATIENCE_S = 120.0  # a limit for a process that hangs


def work(tell, how):
    tell(0.25, f"{how} begins")
    if how == "fails":
        raise JointIdError("this cannot be done: do that")
    if how == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "hangs":
        time.sleep(10.0 * PATIENCE_S)
    return {"answer": 42}


def wait(child, condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_result_comes_with_what_was_told_before():
    child = ChildProcess(work, "works")
    assert child.result() == []  # it does not wait
    wait(child, child.result)
    assert child.result() == [{"answer": 42}]
    assert (child.share, child.text) == (0.25, "works begins")
    child.end()


@pytest.mark.parametrize(("how", "says"), [("fails", "this cannot be done: do that"), ("dies", "exit code -9")])
def test_an_error_and_a_death_are_told(how, says):
    child = ChildProcess(work, how)
    with pytest.raises(JointIdError, match=says):
        wait(child, child.result)
    child.end()


def test_it_ends_on_demand_and_again():
    child = ChildProcess(work, "hangs")
    wait(child, lambda: child.result() == [] and child.text)
    child.end()
    assert not child._process.is_alive()
