"""Threads for the computations of the identifier, so that no callback waits for a fit."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from joint_id_core.data.instants import NANO
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_ros.callbacks import Callbacks
from joint_id_ros.joint_identifiers import JointIdentifiers, place_of
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.sample_queue import SampleQueue
from joint_id_ros.samples import to_recordings
from joint_id_ros.silence import STEP_S, Silence

IDLE_S = STEP_S  # time after which what has arrived is used even if it is little
# A batch holds samples of this share of a hop, of this time at least and of `IDLE_S` at most, and never of more than a
# hop: its cost hardly depends on their number.
GATHER, GATHER_S = 0.2, 0.02
# A batch that takes longer holds fits of whole windows: other threads help, and each estimate is published at once.
# Quick updates are slower with several threads, which take the interpreter from each other.
LONG_S = 0.05
GONE_S = 2.0  # a joint that the samples have not named for so long is not identified any more
PAUSE_S = 30.0  # without any samples, up to which the identifiers go on as after a gap
STOP_S = 2.0  # longest wait for the thread; launch and systemd kill a process that needs 5 s or more to end


def gathered_s(hop_s: float) -> float:
    """Return the time in s of the samples that one batch holds while more arrive."""
    return min(hop_s, max(GATHER_S, min(GATHER * hop_s, IDLE_S)))


@dataclass
class _Batch:
    """Samples that are being used: recordings that wait, by joint, age of the newest sample, and when it was begun."""

    work: deque[tuple[str, Recording]]
    newest_ns: int
    begun_s: float
    helpers: list[threading.Thread] = field(default_factory=list)

    @property
    def long(self) -> bool:
        """Whether it takes long."""
        return time.monotonic() - self.begun_s > LONG_S


class Worker:
    """One `OnlineIdentifier` per joint in a background thread; for fits of several joints, up to one thread per core.

    All samples that arrived during a fit go into one update. So if fits take longer than a hop, windows are skipped and
    the results stay current. No more samples wait than `SampleQueue` holds; beyond that the oldest are left out.
    Recorded samples have time: no window is skipped, and none is left out if nothing is added while the worker is full.

    Attributes:
        missed: number of hops without an estimate because a fit took too long.
        left_out: number of samples left out because they waited too long.
    """

    def __init__(
        self,
        make: Callable[[str, Recording], OnlineIdentifier],
        joints: Collection[str],
        expected: Collection[str],
        callbacks: Callbacks,
        hop_s: float,
        known: Collection[str] = (),
        recorded: bool = False,
    ) -> None:
        """Start the thread.

        Args:
            make: builds the identifier of a joint, given its name and first samples.
            joints: joints to identify; empty for every joint in the samples.
            expected: joints that must be in the samples; a missing one is reported as a problem.
            callbacks: callbacks for estimates and problems.
            hop_s: time in s after which an estimate of each joint is due.
            known: joints that were published before the first sample; those not in the samples are gone, too.
            recorded: whether the samples are of a recording, so that no hurry is needed.
        """
        self.missed = self.left_out = 0
        self._hop_s = hop_s
        self._enough_ns = int(0.5 * gathered_s(hop_s) * NANO)  # readings at equal intervals find more and less
        self._recorded = recorded
        self._queue = SampleQueue(int(gathered_s(hop_s) * NANO) if recorded else None)
        self._lock = threading.Lock()  # for the batch
        self._batch: _Batch | None = None
        self._done_ns: dict[str, int] = {}  # newest sample that an identifier has taken, by joint
        self._named_ns: dict[str, int] = {}  # newest sample in which a joint was named
        self._known = tuple(known)
        self._longest_lag_s = 0.0
        self._wanted, self._expected, self._callbacks = tuple(joints), tuple(expected), callbacks
        self._silence, self._silent = Silence(callbacks.now_s), False
        self._identifiers = JointIdentifiers(make, callbacks.problem)
        self._origin_ns: int | None = None
        self._working = False
        self._stop, self._arrived = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="identifier", daemon=True)
        self._thread.start()

    @property
    def backlog(self) -> int:
        """Number of samples that wait."""
        return len(self._queue)

    @property
    def busy_s(self) -> float:
        """Duration so far of the longest running fit in s; 0 if no fit is running."""
        return self._identifiers.busy_s

    @property
    def full(self) -> bool:
        """Whether no more recorded samples should be added for now."""
        return self._queue.full

    @property
    def idle(self) -> bool:
        """Whether every sample has been used."""
        return not self._queue and not self._working

    @property
    def waiting(self) -> list[str]:
        """Joints whose newest samples, if not recorded, have waited for longer than a hop."""
        if self._recorded:
            return []
        late_ns = self._queue.newest_ns - int(self._hop_s * NANO)
        return sorted(joint for joint, done_ns in self._done_ns.copy().items() if done_ns < late_ns)

    def lag_s(self) -> float:
        """Return how far the identifiers were behind the newest sample at worst, in s, since the last call.

        Recorded samples wait for them: 0.
        """
        if self._recorded:
            return 0.0
        now_s = max((self._queue.newest_ns - done_ns for done_ns in self._done_ns.copy().values()), default=0) / NANO
        longest, self._longest_lag_s = max(now_s, self._longest_lag_s), 0.0
        return longest

    def add(self, message: RawMessage) -> None:
        """Add a sample without error; samples must come in the order of their stamps."""
        count = self._queue.add(message)
        if count:
            self.left_out += count
            self._callbacks.problem(
                "lost by this computer",
                f"{count} samples left out: they waited for fits, which are slower than the samples come. Identify "
                "fewer joints, or take a longer hop_s",
            )

    def wake(self) -> None:
        """Use the samples that were added, if these are enough; start threads that help if those before take long."""
        with self._lock:
            batch = self._batch
            if batch is not None and batch.long and not batch.helpers:
                for _ in range(min(len(batch.work), (os.cpu_count() or 1) - 1)):
                    # daemon threads, like the first one: a compilation must not delay the end of the process
                    helper = threading.Thread(target=self._fit_all, args=(batch,), name="identifier", daemon=True)
                    batch.helpers.append(helper)
                    helper.start()
        if self._queue.covers(self._enough_ns):
            self._arrived.set()

    def restart(self) -> None:
        """Forget all earlier samples: a new run begins with the next sample."""
        self._queue.restart()

    def stop(self) -> None:
        """End the thread. A fit or a compilation that takes longer than `STOP_S` is abandoned."""
        self._stop.set()
        self._arrived.set()
        self._thread.join(STOP_S)

    def _run(self) -> None:
        while True:
            if not self._queue.covers(self._enough_ns):
                self._arrived.wait(IDLE_S)
            self._arrived.clear()
            if self._stop.is_set():
                return
            self._working = True
            batch, new_run = self._queue.take()
            if new_run:
                self._identifiers.clear()
                self._done_ns.clear()
                self._named_ns.clear()
                self._known = ()
                self._origin_ns = None
            try:
                if batch:
                    self._update(batch)
                if not self._recorded:
                    self._look_for_silence(self._silence.look(bool(batch)))
            except JointIdError as error:
                self._callbacks.problem("samples left out", str(error))
            except Exception as error:  # a bug must not end the thread silently
                self._callbacks.problem("internal error", f"samples left out after {place_of(error)}")
            self._working = False

    def _update(self, batch: list[tuple[int, RawMessage]]) -> None:
        if self._origin_ns is None:
            self._origin_ns = batch[0][1].stamp_ns
            self._named_ns = dict.fromkeys(self._known, batch[0][0])
        new = to_recordings([message for _, message in batch], self._origin_ns, "joint_samples")
        recordings = self._callbacks.completed(new)
        self._identifiers.watch(recordings)
        self._forget_the_gone(recordings, batch[-1][0])
        for joint in self._expected:
            if joint not in recordings:
                have = ", ".join(recordings)
                self._callbacks.problem(
                    "missing joint",
                    f"joint {joint} is not in joint_samples (it has {have}): check parameters joints, set, fix, free",
                )
        work = deque((joint, r) for joint, r in recordings.items() if not self._wanted or joint in self._wanted)
        for joint, _ in work:
            self._done_ns.setdefault(joint, batch[0][0])
        current = _Batch(work, batch[-1][0], time.monotonic())
        with self._lock:
            self._batch = current
        self._fit_all(current)
        with self._lock:
            self._batch = None
        for helper in current.helpers:
            helper.join()
        if not self._stop.is_set():
            self._callbacks.publish()
        for joint in recordings:
            if not self._stop.is_set():
                self._identifiers.finish(joint)

    def _forget_the_gone(self, joints: Collection[str], newest_ns: int) -> None:
        """End the identification of joints that the samples do not name any more."""
        self._named_ns |= dict.fromkeys(joints, newest_ns)
        gone = [j for j, named_ns in self._named_ns.items() if newest_ns - named_ns > GONE_S * NANO]
        for joint in gone:
            self._callbacks.problem("joint gone", f"joint {joint} is not in joint_samples any more: it is left out")
        self._forget(gone)

    def _look_for_silence(self, silent_s: float) -> None:
        """Tell that no samples come, once; after a longer pause end the identification of all joints."""
        joints, before, self._silent = list(self._named_ns), self._silent, silent_s > GONE_S
        if self._silent and not before and joints:
            text = f"no joint_samples for {GONE_S:.0f} s: until they come again, no estimate of {', '.join(joints)}"
            self._callbacks.problem("no samples", text)
            for joint in joints:
                self._callbacks.silent(joint)
        if silent_s > PAUSE_S:
            self._forget(joints)

    def _forget(self, joints: Sequence[str]) -> None:
        """End the identification of joints."""
        for joint in joints:
            self._named_ns.pop(joint)
            self._done_ns.pop(joint, None)
            self._identifiers.forget(joint)
            self._callbacks.gone(joint)

    def _fit_all(self, batch: _Batch) -> None:
        """Fit the joints of a batch until none is left; several threads run this at the same time."""
        origin_ns = self._origin_ns
        assert origin_ns is not None
        while not self._stop.is_set():
            try:
                joint, recording = batch.work.popleft()
            except IndexError:
                return
            self._fit(joint, recording, origin_ns)
            self._done_ns[joint] = batch.newest_ns
            self._longest_lag_s = max(self._longest_lag_s, (self._queue.newest_ns - batch.newest_ns) / NANO)
            if batch.long and not self._stop.is_set():
                self._callbacks.publish()

    def _fit(self, joint: str, recording: Recording, origin_ns: int) -> None:
        estimate = self._identifiers.update(joint, recording)
        if estimate is not None:
            if not self._stop.is_set():
                self._callbacks.estimated(joint, estimate, origin_ns)
            self._count_missed(recording)

    def _count_missed(self, recording: Recording) -> None:
        """Count the hops that the samples of one estimate cover, without gaps, but the first."""
        if recording.duration < 1.4 * self._hop_s:
            return
        covered_s = len(recording) * float(np.median(np.diff(recording.time)))
        with self._lock:
            self.missed += max(0, round(covered_s / self._hop_s) - 1)
