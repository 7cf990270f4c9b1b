"""The stream goes on through everything a connection can do, and tells of it."""

import logging
import math
import re
import threading
import time
from types import SimpleNamespace

import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.client import Sample
from joint_id_core.rtde.errors import ProtocolError, RefusedError, UnreachableError
from joint_id_core.rtde.stream import StreamOptions, StreamState

from .watched_stream import LONG, PATIENCE_S, QUICK, FakeClient, Watch, samples, wait_for, watching

watch = pytest.fixture(watching)


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
