"""A stream of RTDE whose clients play what they are told to, and all that it calls back with."""

import threading
import time
from collections import deque

from joint_id_core.rtde.client import Sample
from joint_id_core.rtde.errors import UnreachableError
from joint_id_core.rtde.stream import RobotStream, StreamOptions

PATIENCE_S = 20.0  # a limit for tests that hang
SOON_S = 0.05  # in which nothing is expected to come
RATE = 500.0
QUICK = StreamOptions(stall_s=0.05, backoff_s=0.01, backoff_max_s=0.02)
LONG = StreamOptions(stall_s=60.0, backoff_s=60.0, backoff_max_s=600.0)  # nothing happens by itself


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


def watching():
    """For a fixture: start a watched stream."""
    watches = []

    def start(*clients, **settings):
        watches.append(w := Watch(*clients, **settings))
        w.stream.start()
        return w

    yield start
    for w in watches:
        w.stream.stop()
        assert not w.stream._thread.is_alive()
