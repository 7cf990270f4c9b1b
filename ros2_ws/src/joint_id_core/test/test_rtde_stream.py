"""The stream goes on through everything a connection can do, tells of it, and stops when it is told to."""

import logging
import math
import re
import socket
import threading
import time
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.client import Request, Sample
from joint_id_core.rtde.errors import ProtocolError, RefusedError, UnreachableError
from joint_id_core.rtde.loss import LossCounter
from joint_id_core.rtde.socket_client import SocketClient
from joint_id_core.rtde.stream import RobotStream, StreamOptions, StreamState

PATIENCE_S = 20.0  # a limit for tests that hang
SOON_S = 0.05  # in which nothing is expected to come
RATE = 500.0
QUICK = StreamOptions(stall_s=0.05, backoff_s=0.01, backoff_max_s=0.02)


def samples(*numbers):
    return [Sample(10**9 + k, {"timestamp": 100.0 + 0.002 * k}) for k in numbers]


def wait_for(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


class FakeClient:
    """Plays what one connection brings: lists of samples, or an exception; then it is silent until it is closed.

    An exception comes from `open` or `start` where it is wanted there.
    """

    def __init__(self, *reads, open=None, start=None):
        self.version = ()
        self.messages = deque()
        self.closed = threading.Event()
        self._reads, self._open, self._start = deque(reads), open, start

    def open(self):
        self.version = (5, 13, 0, 0)
        if self._open is not None:
            raise self._open

    def start(self):
        if self._start is not None:
            raise self._start

    def read(self, timeout):
        if self._reads:
            read = self._reads.popleft()
            if isinstance(read, Exception):
                raise read
            return read() if callable(read) else read
        if self.closed.wait(timeout):
            raise UnreachableError("closed on this side")
        return []

    def close(self):
        self.closed.set()


class Watch:
    """A stream of fake clients, and all that it has called back with."""

    def __init__(self, *clients, options=QUICK, rate=RATE):
        self.samples, self.events = [], []
        self.clients = deque(clients)
        self.made = 0
        self.stream = RobotStream(self._make, rate, options, self._on_samples, self._on_event)

    def _make(self):
        self.made += 1
        client = self.clients.popleft() if self.clients else FakeClient()
        if isinstance(client, Exception):
            raise client
        return client

    def _on_samples(self, got):
        assert threading.current_thread().name == "rtde"
        self.samples += got

    def _on_event(self, kind, text):
        assert threading.current_thread().name == "rtde"
        self.events.append((kind, text))

    def kinds(self):
        return [kind for kind, _ in self.events]

    def text(self, kind):
        """Text of the last event of a kind."""
        return [text for k, text in self.events if k == kind][-1]


@pytest.fixture
def watch():
    """Start a watched stream."""
    watches = []

    def start(*clients, **settings):
        watches.append(w := Watch(*clients, **settings))
        w.stream.start()
        return w

    yield start
    for w in watches:
        w.stream.stop()
        assert not w.stream._thread.is_alive()


LONG = StreamOptions(stall_s=60.0, backoff_s=60.0, backoff_max_s=600.0)  # nothing happens by itself


def test_samples_are_passed_on_in_order_and_counted(watch):
    w = watch(FakeClient(samples(1, 2), samples(3)), options=LONG)
    wait_for(lambda: len(w.samples) == 3)
    assert w.samples == samples(1, 2, 3)
    status = w.stream.status
    assert (status.state, status.version, status.error) == (StreamState.STREAMING, (5, 13, 0, 0), "")
    assert (status.received, status.lost, status.reconnects) == (3, 0, 0)
    assert 0.0 <= status.age_s < PATIENCE_S
    assert w.events == [("connected", "controller 5.13.0.0 sends at 500 Hz")]
    w.stream.stop()
    assert w.stream.status.state is StreamState.STOPPED
    assert w.stream.status.error == ""
    assert w.kinds() == ["connected"]


def test_before_the_first_sample(watch):
    w = Watch(options=LONG)
    assert (w.stream.status.state, w.stream.status.age_s) == (StreamState.CONNECTING, math.inf)
    w.stream.stop()
    assert w.made == 0


def test_lost_samples_are_counted_within_a_connection_only(watch):
    w = watch(
        FakeClient(samples(1, 2, 5), samples(6, 16), UnreachableError("cable")),
        FakeClient(samples(1000, 1002)),
        options=StreamOptions(stall_s=60.0, backoff_s=0.01),
    )
    wait_for(lambda: w.stream.status.received == 7)
    assert (w.stream.status.lost, w.stream.status.reconnects) == (2 + 9 + 1, 1)
    assert w.samples == samples(1, 2, 5, 6, 16, 1000, 1002)
    kinds = w.kinds()
    assert [k for k in kinds if k != "samples lost"] == ["connected", "connection lost", "connected"]
    assert w.text("connection lost") == "cable"
    assert w.events[1] == ("samples lost", "2 samples lost, 2 since the start")
    text, _, gap = w.text("connected").rpartition(", after ")
    assert text == "controller 5.13.0.0 sends at 500 Hz" and gap.endswith(" s without samples")
    assert 0.01 <= float(gap.split()[0]) < PATIENCE_S


def test_losses_of_a_second_are_told_together(watch, monkeypatch):
    now = [1000.0]
    monkeypatch.setattr("joint_id_core.rtde.stream.time", SimpleNamespace(monotonic=lambda: now[0]))

    def later(seconds, *numbers):
        def read():
            now[0] += seconds
            return samples(*numbers)

        return read

    reads = [samples(0), later(0.004, 2), later(0.5, 252), later(0.4, 452, 453), later(0.2, 553), later(0.1, 554)]
    w = watch(FakeClient(*reads), options=LONG)
    wait_for(lambda: len(w.samples) == 7)
    lost = [1, 249, 199, 99]
    assert w.stream.status.lost == sum(lost)
    told = [text for kind, text in w.events if kind == "samples lost"]
    assert told == ["1 samples lost, 1 since the start", f"{sum(lost[1:])} samples lost, {sum(lost)} since the start"]


def test_a_silent_robot_is_given_up(watch):
    w = watch(FakeClient(samples(1)), FakeClient(samples(2), UnreachableError("end")))
    wait_for(lambda: "connection lost" in w.kinds())
    assert w.kinds()[:3] == ["connected", "stalled", "connected"]
    assert w.text("stalled") == "no sample for 0.05 s: the robot or the network is silent"


def test_a_robot_that_starts_but_sends_nothing_is_not_connected(watch):
    first = FakeClient()
    w = watch(first, FakeClient(), FakeClient(samples(1)))
    wait_for(lambda: w.samples)
    assert w.kinds() == ["stalled", "connected"]
    assert w.stream.status.reconnects == 0
    assert first.closed.is_set()


def test_a_slow_stream_is_not_taken_as_stalled(watch):
    def slow():
        return samples(1)

    w = watch(FakeClient(slow), rate=1.0)
    wait_for(lambda: w.samples)
    time.sleep(3.0 * QUICK.stall_s)
    assert w.kinds() == ["connected"]


def failing(**how):
    return lambda: FakeClient(**how)


@pytest.mark.parametrize(
    ("make", "kind", "text"),
    [
        (failing(open=UnreachableError("nobody there")), "unreachable", "nobody there"),
        (failing(start=UnreachableError("gone")), "unreachable", "gone"),
        (failing(open=ProtocolError("a web server")), "not RTDE", "a web server"),
        (failing(open=RefusedError("no such field")), "refused", "no such field; trying again every 0.02 s"),
        (failing(open=OSError(24, "Too many files")), "internal error", "OSError in open .*: .*Too many files"),
        (lambda: MemoryError("none\nleft"), "internal error", "MemoryError in _make .*: none left"),
    ],
)
def test_what_goes_wrong_is_told_once_and_tried_again(watch, make, kind, text):
    w = watch(make(), make(), make(), FakeClient(samples(1)), options=StreamOptions(60.0, 0.01, 0.02))
    wait_for(lambda: w.samples)
    assert w.kinds() == [kind, "connected"]
    assert re.fullmatch(text, w.text(kind))
    assert w.made == 4


@pytest.mark.parametrize(
    ("reads", "kind", "text"),
    [
        ([samples(1), UnreachableError("cable")], "connection lost", "cable"),
        ([samples(1), ProtocolError("noise")], "not RTDE", "noise"),
        ([samples(1), KeyError("timestamp")], "internal error", "KeyError in read .*: 'timestamp'"),
    ],
)
def test_an_end_of_the_stream_is_told_every_time(watch, reads, kind, text):
    w = watch(FakeClient(*reads), FakeClient(*reads), options=StreamOptions(60.0, 0.01, 0.02))
    wait_for(lambda: w.made == 3)
    assert w.kinds() == ["connected", kind] * 2
    assert re.fullmatch(text, w.text(kind))
    assert re.fullmatch(text, w.stream.status.error)


class Waits(threading.Event):
    """Notes how long it is waited for instead of waiting."""

    def __init__(self):
        super().__init__()
        self.lengths = []

    def wait(self, timeout=None):
        self.lengths.append(timeout)
        return super().wait(0.0)


def test_the_waits_double_up_to_the_longest_and_begin_anew_after_a_stream():
    lost = UnreachableError("x")
    clients = [FakeClient(open=lost) for _ in range(5)] + [FakeClient(samples(1), lost), FakeClient(open=lost)]
    clients += [FakeClient(open=RefusedError("y")), FakeClient(open=lost), FakeClient(samples(1))]
    w = Watch(*clients, options=StreamOptions(stall_s=60.0, backoff_s=0.1, backoff_max_s=0.5))
    w.stream._stopping = waits = Waits()
    w.stream.start()
    wait_for(lambda: len(w.samples) == 2)
    w.stream.stop()
    assert waits.lengths == [0.0, 0.1, 0.2, 0.4, 0.5, 0.5, 0.1, 0.2, 0.5, 0.5]


def test_an_exception_of_the_receiver_ends_nothing(watch):
    w = Watch(FakeClient(samples(1), samples(2), samples(3)), options=LONG)
    passed = []

    def on_samples(got):
        passed.extend(got)
        if len(passed) < 3:
            raise RuntimeError("full\ndisk")

    w.stream._on_samples = on_samples
    w.stream.start()
    wait_for(lambda: len(passed) == 3)
    w.stream.stop()
    assert w.kinds()[:2] == ["connected", "internal error"]
    assert re.fullmatch(r"RuntimeError in on_samples \(test_rtde_stream.py:\d+\): full disk", w.text("internal error"))
    assert w.stream.status.received == 3


def test_an_exception_of_who_is_told_ends_nothing(caplog):
    w = Watch(FakeClient(samples(1), samples(2)), options=LONG)

    def on_event(kind, text):
        raise RuntimeError("nobody listens")

    w.stream._on_event = on_event
    with caplog.at_level(logging.ERROR):
        w.stream.start()
        wait_for(lambda: len(w.samples) == 2)
        w.stream.stop()
    assert "nobody listens" in caplog.text and "connected" in caplog.text


def test_texts_of_the_controller_are_passed_on(watch):
    client = FakeClient(samples(1))
    client.messages.extend(["one", "two"])
    w = watch(client, options=LONG)
    wait_for(lambda: w.samples)
    assert w.events[:2] == [("message", "one"), ("message", "two")]


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


def test_a_clock_that_jumps_is_told_and_is_no_loss(watch):
    jumped = [Sample(0, {"timestamp": t}) for t in (500.0, 500.002, 3.0, 3.002)]
    w = watch(FakeClient(samples(1, 2), jumped, samples(10**6)), options=LONG)
    wait_for(lambda: len(w.samples) == 7)
    assert w.stream.status.lost == 0
    assert w.events[1:] == [("clock jumped", "the controller's clock jumped, to 500.000 s")]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stall_s": 0.001}, r"option stall_s = 0.001 s: must be in \[0.02, 60.0\]"),
        ({"backoff_s": 0.0}, "option backoff_s = 0.0 s"),
        ({"backoff_s": 6.0}, "option backoff_max_s = 5.0 s: must be at least backoff_s = 6.0 s"),
    ],
)
def test_options_are_checked(values, message):
    with pytest.raises(JointIdError, match=message):
        StreamOptions(**values)


def losses(times, arrivals, rate=RATE):
    counter = LossCounter(rate)
    return [counter.count(t, a) for t, a in zip(times, arrivals, strict=True)]


def test_loss_is_counted_by_the_time_stamps_however_late_samples_arrive():
    rng = np.random.default_rng(1)
    kept = np.flatnonzero(rng.random(20_000) > 0.02)
    times = 5000.0 + kept / RATE
    arrivals = np.maximum.accumulate(70.0 + kept / RATE + rng.exponential(0.001, len(kept)))
    stall = (kept > 8000) & (kept < 9000)
    arrivals[stall] = arrivals[stall][-1]  # two seconds of samples at once
    counted = losses(times, arrivals)
    assert counted == [0, *(np.diff(kept) - 1).tolist()]
    assert sum(counted) > 200


def test_a_gap_is_a_loss_when_time_has_passed_and_a_jump_when_it_has_not():
    assert losses([10.0, 10.002, 13.002, 13.004], [0.0, 0.002, 3.002, 3.004]) == [0, 0, 1499, 0]
    assert losses([10.0, 10.002, 13.002, 13.004], [0.0, 0.002, 0.004, 0.006]) == [0, 0, None, 0]
    assert losses([10.0, 10.002, 4.0, 4.002, 4.008], [0.0, 0.002, 0.004, 0.006, 0.012]) == [0, 0, None, 0, 2]


def test_a_sample_without_a_time_has_still_arrived():
    assert losses([10.0, 0.0, math.nan, 10.006], [0.0, 0.002, 0.004, 0.006]) == [0, 0, 0, 0]
    assert losses([10.0, math.inf, 10.010], [0.0, 0.002, 0.010]) == [0, 0, 3]
    assert losses([10.0, 10.0, 10.002], [0.0, 0.001, 0.002]) == [0, 0, 0]


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_drift_apart_for_hours_make_no_jump_and_hide_none(drift):
    seconds = np.arange(0.0, 8.0 * 3600.0, 1.0)
    times = 100.0 + seconds * (1.0 + drift)
    times[-1] += 1.5  # which must not be lost in 3 s of drift
    assert losses(times, seconds, rate=1.0) == [*[0] * (len(seconds) - 1), None]
