"""Threads for the computations of the identifier, so that no callback waits for a fit."""

from __future__ import annotations

import os
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.results.estimate import Estimate
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.samples import to_recordings

POLL_S = 0.02  # time between two checks for new samples: well below a hop, well above a sampling period

STOP_S = 2.0  # longest wait for the thread; launch and systemd kill a process that needs 5 s or more to end


@dataclass(frozen=True)
class Callbacks:
    """Callbacks of a worker, called from its threads."""

    estimated: Callable[[str, Estimate, int], None]  # joint, estimate, origin of its times in ns
    problem: Callable[[str, str], None]  # kind, text


class Worker:
    """One `OnlineIdentifier` per joint in a background thread; with several joints, up to one thread per core.

    All samples that arrived during a fit go into one update. So if fits take longer than a hop, windows are skipped and
    the results stay current.
    """

    def __init__(
        self,
        make: Callable[[str, Recording], OnlineIdentifier],
        joints: Collection[str],
        expected: Collection[str],
        callbacks: Callbacks,
    ) -> None:
        """Start the thread.

        Args:
            make: builds the identifier of a joint, given its name and first samples.
            joints: joints to identify; empty for every joint in the samples.
            expected: joints that must be in the samples; a missing one is reported as a problem.
            callbacks: callbacks for estimates and problems.
        """
        self._make, self._wanted, self._expected, self._callbacks = make, tuple(joints), tuple(expected), callbacks
        self._identifiers: dict[str, OnlineIdentifier] = {}
        self._pending: deque[RawMessage | None] = deque()
        self._origin_ns: int | None = None
        self._begun: dict[str, float] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="identifier", daemon=True)
        self._thread.start()

    @property
    def backlog(self) -> int:
        """Number of samples that wait."""
        return len(self._pending)

    @property
    def busy_s(self) -> float:
        """Duration so far of the longest running fit in s; 0 if no fit is running."""
        now = time.monotonic()
        return now - min(self._begun.copy().values(), default=now)

    def add(self, message: RawMessage) -> None:
        """Add a sample without error; samples must come in the order of their stamps."""
        self._pending.append(message)

    def restart(self) -> None:
        """Forget all earlier samples: a new run begins with the next sample."""
        self._pending.append(None)

    def stop(self) -> None:
        """End the thread. A fit or a compilation that takes longer than `STOP_S` is abandoned."""
        self._stop.set()
        self._thread.join(STOP_S)

    def _run(self) -> None:
        while not self._stop.wait(POLL_S):
            batch: list[RawMessage] = []
            while self._pending:
                message = self._pending.popleft()
                if message is None:
                    self._identifiers.clear()
                    self._origin_ns = None
                    batch = []
                else:
                    batch.append(message)
            try:
                if batch:
                    self._update(batch)
            except JointIdError as error:
                self._callbacks.problem("samples left out", str(error))
            except Exception as error:  # a bug must not end the thread silently
                self._callbacks.problem("internal error", f"samples left out after {_where(error)}")

    def _update(self, batch: list[RawMessage]) -> None:
        if self._origin_ns is None:
            self._origin_ns = batch[0].stamp_ns
        recordings = to_recordings(batch, self._origin_ns, "joint_samples")
        for joint in self._expected:
            if joint not in recordings:
                have = ", ".join(recordings)
                self._callbacks.problem(
                    "missing joint",
                    f"joint {joint} is not in joint_samples (it has {have}): check parameters joints, set, fix, free",
                )
        work = deque((joint, r) for joint, r in recordings.items() if not self._wanted or joint in self._wanted)
        count = min(len(work), os.cpu_count() or 1)
        # daemon threads, like this one: a compilation must not delay the end of the process
        helpers = [threading.Thread(target=self._fit_all, args=(work,), daemon=True) for _ in range(count - 1)]
        for helper in helpers:
            helper.start()
        self._fit_all(work)
        for helper in helpers:
            helper.join()

    def _fit_all(self, work: deque[tuple[str, Recording]]) -> None:
        """Fit joints until none is left; several threads run this at the same time."""
        origin_ns = self._origin_ns
        assert origin_ns is not None
        while not self._stop.is_set():
            try:
                joint, recording = work.popleft()
            except IndexError:
                return
            self._fit(joint, recording, origin_ns)

    def _fit(self, joint: str, recording: Recording, origin_ns: int) -> None:
        try:
            self._begun[joint] = time.monotonic()
            if joint not in self._identifiers:
                self._identifiers[joint] = self._make(joint, recording)
            estimate = self._identifiers[joint].update(recording)
        except JointIdError as error:
            self._callbacks.problem("samples left out", f"joint {joint}: {error}")
        except Exception as error:  # a bug must not end the thread silently
            self._identifiers.pop(joint, None)
            self._callbacks.problem(
                "internal error", f"joint {joint}: identification starts anew after {_where(error)}"
            )
        else:
            if estimate is not None and not self._stop.is_set():
                self._callbacks.estimated(joint, estimate, origin_ns)
        finally:
            self._begun.pop(joint, None)


def _where(error: Exception) -> str:
    """Return an exception and the place that raised it, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {' '.join(str(error).split())} ({frame.filename}:{frame.lineno})"
