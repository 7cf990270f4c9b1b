"""Continuous stream of a robot's samples: a thread that reads, reports losses, and reconnects."""

from __future__ import annotations

import logging
import math
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option
from joint_id_core.rtde.client import Client, Sample
from joint_id_core.rtde.errors import ProtocolError, RefusedError, RobotError, UnreachableError
from joint_id_core.rtde.loss import LossCounter

log = logging.getLogger(__name__)

_LEAST_PERIODS = 5  # periods without a sample before the stream counts as stalled, also at low rates
_TELL_EVERY_S = 1.0  # shortest time between events of a kind that may come with every sample
_JOIN_S = 2.0


@dataclass(frozen=True)
class StreamOptions:
    """When to give a connection up, and how long to wait before the next try."""

    stall_s: float = option(0.5, "silence after which the connection is given up (at least 5 samples)", "s", 0.02, 60.0)
    backoff_s: float = option(
        0.1, "wait before the first try to connect again; doubles with every try", "s", 0.01, 60.0
    )
    backoff_max_s: float = option(5.0, "longest wait between two tries", "s", 0.01, 600.0)

    def __post_init__(self) -> None:
        check(self)
        if self.backoff_max_s < self.backoff_s:
            raise JointIdError(
                f"option backoff_max_s = {self.backoff_max_s} s: must be at least backoff_s = {self.backoff_s} s"
            )


class StreamState(Enum):
    """State of the stream."""

    CONNECTING = "connecting"
    STREAMING = "streaming"
    WAITING = "waiting to connect again"
    STOPPED = "stopped"


@dataclass(frozen=True)
class StreamStatus:
    """The stream at one instant.

    Attributes:
        state: its state.
        version: version of the controller, (major, minor, bugfix, build); () until it is known.
        received: number of samples since the start.
        lost: number of missing samples according to the time stamps, without those while there was no connection.
        reconnects: number of connections with samples, without the first one.
        age_s: time in s since the newest sample; inf before the first.
        error: what is wrong; "" while streaming.
    """

    state: StreamState
    version: tuple[int, ...]
    received: int
    lost: int
    reconnects: int
    age_s: float
    error: str


class RobotStream:
    """Reads samples in its own thread and reconnects until it is stopped.

    Every connection uses a new client, so that each requests the same fields and rate.

    Args:
        make: builds a client.
        rate: rate in Hz that the clients request.
        options: see `StreamOptions`.
        on_samples: called with the samples that have arrived, in order.
        on_event: called with a kind and a text when something changes: "connected", "unreachable", "refused",
            "not RTDE", "connection lost", "stalled", "samples lost", "clock jumped", "message" (a text of the
            controller), "internal error" (an exception, also one of the callbacks; the stream goes on).
            Kinds that could come with every sample are reported at most once per second.

    Both callbacks are called from the stream's thread.
    """

    def __init__(
        self,
        make: Callable[[], Client],
        rate: float,
        options: StreamOptions,
        on_samples: Callable[[list[Sample]], None],
        on_event: Callable[[str, str], None],
    ) -> None:
        self._make, self._rate, self._options = make, rate, options
        self._on_samples, self._on_event = on_samples, on_event
        self._stall_s = max(options.stall_s, _LEAST_PERIODS / rate)
        self._thread = threading.Thread(target=self._run, name="rtde", daemon=True)
        self._stopping = threading.Event()
        self._untold_loss = 0
        self._told_at: dict[str, float] = {}  # by kind of event, time.monotonic()
        self._lock = threading.Lock()  # guards what follows
        self._client: Client | None = None
        self._state, self._error = StreamState.CONNECTING, ""
        self._version: tuple[int, ...] = ()
        self._received = self._lost = self._connections = 0
        self._newest_at = -math.inf  # time.monotonic()

    def start(self) -> None:
        """Start the thread; call it only once."""
        self._thread.start()

    def stop(self) -> None:
        """End the connection and the thread, within 2 s; any number of times. No callback begins after it returns."""
        self._stopping.set()
        with self._lock:
            client = self._client
        if client is not None:
            client.close()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_JOIN_S)

    @property
    def status(self) -> StreamStatus:
        """Present status of the stream; can be read from any thread."""
        with self._lock:
            return StreamStatus(
                state=StreamState.STOPPED if self._stopping.is_set() else self._state,
                version=self._version,
                received=self._received,
                lost=self._lost,
                reconnects=max(0, self._connections - 1),
                age_s=time.monotonic() - self._newest_at,
                error=self._error,
            )

    def _run(self) -> None:
        wait_s = 0.0
        while not self._stopping.wait(wait_s):
            try:
                self._follow_one_connection()
                continue  # `stop` was called
            except RobotError as error:
                kind, text = _kind(error, self._state), str(error)
                refused = isinstance(error, RefusedError)
            except Exception as error:  # a bug must not end the stream silently
                kind, text, refused = "internal error", _where(error), False
            if self._stopping.is_set():  # the error comes from closing the client
                return
            streamed = self._state is StreamState.STREAMING
            longest = self._options.backoff_max_s
            if refused:
                wait_s = longest
                text += f"; trying again every {longest:g} s"
            else:
                wait_s = self._options.backoff_s if streamed or not wait_s else min(2.0 * wait_s, longest)
            known = text == self._error
            with self._lock:
                self._state, self._error = StreamState.WAITING, text
            if not known:
                self._tell(kind, text)

    def _follow_one_connection(self) -> None:
        """Connect and pass on the samples until `stop` is called.

        Raises:
            RobotError: why the connection ended.
        """
        with self._lock:
            if self._stopping.is_set():  # `stop` has closed the client before this one
                return
            self._state = StreamState.CONNECTING
            client = self._client = self._make()
        try:
            client.open()
            with self._lock:
                self._version = client.version
            client.start()
            losses = LossCounter(self._rate)
            while not self._stopping.is_set():
                samples = client.read(self._stall_s)
                now = time.monotonic()
                while client.messages:
                    self._tell("message", client.messages.popleft())
                if samples:
                    if self._state is not StreamState.STREAMING:
                        self._connected(now)
                    self._count(samples, losses, now)
                    self._call(self._on_samples, samples)
                elif not self._stopping.is_set():
                    raise _StalledError(f"no sample for {self._stall_s:g} s: the robot or the network is silent")
        finally:
            client.close()

    def _connected(self, now: float) -> None:
        silence_s = now - self._newest_at
        with self._lock:
            self._state, self._error = StreamState.STREAMING, ""
            self._connections += 1
        text = f"controller {'.'.join(map(str, self._version))} sends at {self._rate:g} Hz"
        self._tell("connected", text if silence_s == math.inf else f"{text}, after {silence_s:.3f} s without samples")

    def _count(self, samples: list[Sample], losses: LossCounter, now: float) -> None:
        lost = 0
        for sample in samples:
            timestamp: float = sample.values["timestamp"]  # type: ignore[assignment]  # is a DOUBLE
            missing = losses.count(timestamp, now)
            if missing is not None:
                lost += missing
            elif self._is_due("clock jumped", now):
                self._tell("clock jumped", f"the controller's clock jumped, to {timestamp:.3f} s")
        with self._lock:
            self._received += len(samples)
            self._lost += lost
            self._newest_at = now
        self._untold_loss += lost
        if self._untold_loss and self._is_due("samples lost", now):
            self._tell("samples lost", f"{self._untold_loss} samples lost, {self._lost} since the start")
            self._untold_loss = 0

    def _is_due(self, kind: str, now: float) -> bool:
        """Return whether to report an event of a kind that may come with every sample."""
        if now < self._told_at.get(kind, -math.inf) + _TELL_EVERY_S:
            return False
        self._told_at[kind] = now
        return True

    def _tell(self, kind: str, text: str) -> None:
        self._call(self._on_event, kind, text)

    def _call(self, callback: Callable[..., None], *args: object) -> None:
        """Call a callback unless `stop` was called; an exception of the callback does not end the stream."""
        if self._stopping.is_set():
            return
        try:
            callback(*args)
        except Exception as error:  # a bug in a callback must not end the stream
            if callback == self._on_event:
                log.exception("event %s", args)
            elif self._is_due("internal error", time.monotonic()):
                self._tell("internal error", _where(error))


class _StalledError(UnreachableError):
    """Connected, but no samples."""


def _kind(error: RobotError, state: StreamState) -> str:
    if isinstance(error, _StalledError):
        return "stalled"
    if isinstance(error, RefusedError):
        return "refused"
    if isinstance(error, ProtocolError):
        return "not RTDE"
    return "connection lost" if state is StreamState.STREAMING else "unreachable"


def _where(error: Exception) -> str:
    """Return an exception and the place that raised it, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{frame.name} ({Path(frame.filename).name}:{frame.lineno})"
    return f"{type(error).__name__} in {place}: {' '.join(str(error).split())}"
