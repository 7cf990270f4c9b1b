"""A check of the connection gives version or error, leaves no connection behind, and can be given up."""

import threading

import pytest

from joint_id_core.rtde.connection_check import ConnectionCheck
from joint_id_core.rtde.errors import RefusedError, UnreachableError


class FakeClient:
    """Opens when it is let, or fails."""

    version = (5, 13, 0, 0)

    def __init__(self, error=None, wait=False):
        self.error, self.closed = error, threading.Event()
        self.go_on = threading.Event()
        if not wait:
            self.go_on.set()

    def open(self):
        self.go_on.wait()
        if self.closed.is_set():
            raise UnreachableError("closed on this side")
        if self.error:
            raise self.error

    def close(self):
        self.closed.set()
        self.go_on.set()


def test_the_version_comes_and_the_connection_is_closed():
    client = FakeClient()
    check = ConnectionCheck(client)
    assert check.version() == (5, 13, 0, 0)
    assert check.done and client.closed.is_set()


def test_an_error_of_the_client_is_raised_where_the_version_is_asked_for():
    client = FakeClient(RefusedError("no such field"))
    with pytest.raises(RefusedError, match="no such field"):
        ConnectionCheck(client).version()
    assert client.closed.is_set()


def test_nothing_waits_until_the_version_is_asked_for_and_a_cancelled_check_ends():
    client = FakeClient(wait=True)
    check = ConnectionCheck(client)
    assert not check.done
    check.cancel()
    with pytest.raises(UnreachableError):
        check.version()
    assert check.done


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_defect_of_a_client_is_no_success():
    with pytest.raises(UnreachableError, match="given up"):
        ConnectionCheck(FakeClient(ZeroDivisionError())).version()
