"""The stream stops when it is told to, whatever it waits for, and calls back no more."""

import socket
import threading
import time

import pytest

from joint_id_core.rtde.client import Request
from joint_id_core.rtde.errors import UnreachableError
from joint_id_core.rtde.socket_client import SocketClient
from joint_id_core.rtde.stream import RobotStream, StreamState

from .watched_stream import LONG, PATIENCE_S, RATE, SOON_S, FakeClient, Watch, samples, wait_for, watching

watch = pytest.fixture(watching)


def stopped(stream):
    """Whether it stops while the test still waits."""
    thread = threading.Thread(target=stream.stop)
    thread.start()
    thread.join(PATIENCE_S)
    return not thread.is_alive() and not stream._thread.is_alive()


def test_stops_while_it_waits_for_samples(watch):
    client = FakeClient(samples(1))
    w = watch(client, options=LONG)
    wait_for(lambda: w.samples)
    assert stopped(w.stream) and stopped(w.stream)
    assert client.closed.is_set()


def test_stops_while_it_waits_to_connect_again(watch):
    w = watch(FakeClient(open=UnreachableError("x")), options=LONG)
    wait_for(lambda: w.stream.status.state is StreamState.WAITING)
    assert stopped(w.stream)


@pytest.mark.parametrize("backlog", [0, 5])
def test_stops_while_it_connects_to_a_mute_host(backlog):
    """Without a place in the backlog, the connection itself is waited for; with one, the first answer."""
    with socket.socket() as server, socket.socket() as other:
        server.bind(("127.0.0.1", 0))
        server.listen(backlog)
        if not backlog:
            other.connect(server.getsockname())
        request = Request("127.0.0.1", ("timestamp",), port=server.getsockname()[1], timeout=10.0 * PATIENCE_S)
        events = []
        stream = RobotStream(lambda: SocketClient(request), RATE, LONG, events.append, lambda *e: events.append(e))
        stream.start()
        time.sleep(SOON_S)
        assert stream.status.state is StreamState.CONNECTING
        assert stopped(stream)
        assert events == []


def test_makes_no_client_when_it_was_stopped_meanwhile():
    class SetMeanwhile(threading.Event):
        def wait(self, timeout=None):
            before = self.is_set()
            self.set()
            return before

    w = Watch(FakeClient(samples(1)), options=LONG)
    w.stream._stopping = SetMeanwhile()
    w.stream.start()
    w.stream._thread.join(PATIENCE_S)
    assert not w.stream._thread.is_alive()
    assert (w.made, w.events) == (0, [])


def test_stops_from_its_own_callbacks():
    w = Watch(FakeClient(samples(1), samples(2)), options=LONG)
    passed = []

    def on_samples(got):
        passed.extend(got)
        w.stream.stop()

    w.stream._on_samples = on_samples
    w.stream.start()
    w.stream._thread.join(PATIENCE_S)
    assert not w.stream._thread.is_alive()
    assert passed == samples(1)


def test_does_not_wait_for_a_client_that_hangs_and_calls_back_no_more(monkeypatch):
    monkeypatch.setattr("joint_id_core.rtde.stream._JOIN_S", SOON_S)
    release = threading.Event()

    def hang():
        release.wait(PATIENCE_S)
        return samples(2)

    w = Watch(FakeClient(samples(1), hang), options=LONG)
    w.stream.start()
    wait_for(lambda: w.samples)
    w.stream.stop()
    assert w.stream._thread.is_alive()
    assert w.stream.status.state is StreamState.STOPPED
    release.set()
    w.stream._thread.join(PATIENCE_S)
    assert w.samples == samples(1)
    assert w.kinds() == ["connected"]


def test_no_callback_after_stop():
    """A client that never runs dry, stopped at some instant, again and again."""
    for _ in range(50):
        w = Watch(options=LONG)
        endless = FakeClient()
        endless.read = lambda timeout: samples(1)
        w.clients.append(endless)
        w.stream.start()
        wait_for(lambda w=w: w.samples)
        w.stream.stop()
        count = len(w.samples)
        assert not w.stream._thread.is_alive()
        time.sleep(0.0005)
        assert len(w.samples) == count
