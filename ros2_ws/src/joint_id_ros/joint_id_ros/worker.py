"""Threads for the computations of the identifier, so that no callback waits for a fit."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from joint_id_core.data.instants import NANO
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.online.check_thread import CheckThread
from joint_id_core.online.checks import Background
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_ros.callbacks import Callbacks
from joint_id_ros.joint_identifiers import JointIdentifiers, Taken, place_of
from joint_id_ros.presence import Presence
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.relay import Relay
from joint_id_ros.sample_queue import LOST_HERE, SampleQueue, left_out
from joint_id_ros.samples import to_recordings
from joint_id_ros.silence import STEP_S

IDLE_S = STEP_S  # time after which what has arrived is used even if it is little
# A batch holds samples of this share of a hop, of this time at least and of `IDLE_S` at most, and never of more than a
# hop: its cost hardly depends on their number.
GATHER, GATHER_S = 0.2, 0.02
# A thread that takes longer is in a fit of a whole window: another one goes on, and each estimate is published at once.
# Quick updates are slower with several threads, which take the interpreter from each other.
LONG_S = 0.05
SPARE_THREADS = 2  # more than cores: joints that their models do not describe leave one to the others
USUAL_JOINTS = 7  # of a robot whose joints are not named: those of most arms
STOP_S = 2.0  # longest wait for the thread; launch and systemd kill a process that needs 5 s or more to end


def gathered_s(hop_s: float) -> float:
    """Return the time in s of the samples that one batch holds while more arrive."""
    return min(hop_s, max(GATHER_S, min(GATHER * hop_s, IDLE_S)))


@dataclass(frozen=True)
class _Batch:
    """Samples that are being used.

    Attributes:
        left: joints that no thread has begun with.
        joints: all that the samples name.
        origin_ns: origin of their times.
        begun_s: when a thread began with them, or with those that another one left.
    """

    left: deque[str]
    joints: Collection[str]
    origin_ns: int
    begun_s: float

    @property
    def long(self) -> bool:
        """Whether it takes long."""
        return time.monotonic() - self.begun_s > LONG_S


def threads_for(joints: int) -> int:
    """Return the number of threads for so many joints, 0 if it is not known: no joint is fitted by two at once."""
    return min(os.cpu_count() or 1, joints or USUAL_JOINTS) + SPARE_THREADS


class Worker:
    """One `OnlineIdentifier` per joint in a background thread, which another one relieves while a fit takes long.

    Samples of a joint that arrived during a fit of it go into one update. So if fits take longer than a hop, windows
    are skipped and the results stay current; the other joints go on meanwhile. No more samples wait than `SampleQueue`
    holds; beyond that the oldest are left out. All threads are there from the start, two more than cores or joints.
    Recorded samples have time: no window is skipped, and none is left out if nothing is added while the worker is full.

    Attributes:
        missed: number of hops without an estimate because a fit took too long.
    """

    def __init__(
        self,
        make: Callable[[Background, str, Recording], OnlineIdentifier],
        joints: Collection[str],
        expected: Collection[str],
        callbacks: Callbacks,
        hop_s: float,
        known: Collection[str] = (),
        recorded: bool = False,
    ) -> None:
        """Start the threads.

        Args:
            make: builds the identifier of a joint, given what does its checks, its name and first samples.
            joints: joints to identify; empty for every joint in the samples.
            expected: joints that must be in the samples; a missing one is reported as a problem.
            callbacks: callbacks for estimates and problems.
            hop_s: time in s after which an estimate of each joint is due.
            known: joints that were published before the first sample; those not in the samples are gone, too.
            recorded: whether the samples are of a recording, so that no hurry is needed.
        """
        self.missed = 0
        self._hop_s = hop_s
        self._enough_ns = int(0.5 * gathered_s(hop_s) * NANO)  # readings at equal intervals find more and less
        self._recorded = recorded
        self._queue, self._queue_left_out = SampleQueue(int(gathered_s(hop_s) * NANO) if recorded else None), 0
        self._lock = threading.Lock()  # for the batch
        self._batch: _Batch | None = None  # of the newest thread, while it may be relieved
        self._longest_lag_s = 0.0
        self._wanted, self._expected, self._callbacks = tuple(joints), tuple(expected), callbacks
        self._presence = Presence(callbacks, known)
        self._checks = CheckThread()
        self._identifiers = JointIdentifiers(partial(make, self._checks), callbacks.problem)
        self._origin_ns: int | None = None
        self._working = False
        self._stop, self._arrived = threading.Event(), threading.Event()
        # The thread that leads takes the samples.
        self._relay = Relay[_Batch | None](threads_for(len(self._wanted)), self._run, "identifier")
        self._relay.hand_over(None)

    @property
    def left_out(self) -> int:
        """Number of samples left out because they waited too long; those of one joint count as well."""
        return self._queue_left_out + self._identifiers.left_out

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
        return not self._queue and not self._working and not self._identifiers.busy

    @property
    def waiting(self) -> list[str]:
        """Joints whose newest samples, if not recorded, have waited for longer than a hop."""
        return [] if self._recorded else self._identifiers.behind(self._queue.newest_ns - int(self._hop_s * NANO))

    def lag_s(self) -> float:
        """Return how far the identifiers were behind the newest sample at worst, in s, since the last call.

        Recorded samples wait for them: 0.
        """
        if self._recorded:
            return 0.0
        newest_ns = self._queue.newest_ns
        now_s = (newest_ns - self._identifiers.oldest_ns(newest_ns)) / NANO
        longest, self._longest_lag_s = max(now_s, self._longest_lag_s), 0.0
        return longest

    def add(self, message: RawMessage) -> None:
        """Add a sample without error; samples must come in the order of their stamps."""
        count = self._queue.add(message)
        if count:
            self._queue_left_out += count
            self._callbacks.problem(LOST_HERE, left_out(count))

    def wake(self) -> None:
        """Use the samples that were added, if these are enough; if a fit takes long, another thread goes on."""
        with self._lock:
            batch = self._batch
            # Recorded samples wait until all joints have taken those before.
            if batch is not None and batch.long and (batch.left or not self._recorded):
                left = replace(batch, begun_s=time.monotonic())
                if self._relay.hand_over(left):
                    self._batch = left
        if self._queue.covers(self._enough_ns):
            self._arrived.set()

    def restart(self) -> None:
        """Forget all earlier samples: a new run begins with the next sample."""
        self._queue.restart()

    def stop(self) -> None:
        """End the threads. Fits or compilations that take longer than `STOP_S` are abandoned."""
        self._stop.set()
        self._arrived.set()
        self._checks.stop()
        self._relay.stop(STOP_S)

    def _run(self, left: _Batch | None) -> None:
        """Do what is left of a batch, and use what comes, until the end or until another thread does that."""
        if left is not None:
            self._guarded(self._use, left)
        while self._relay.leads and not self._stop.is_set():
            self._working = False
            if not self._queue.covers(self._enough_ns):
                self._arrived.wait(IDLE_S)
            self._arrived.clear()
            if not self._stop.is_set():
                self._guarded(self._take)

    def _guarded(self, work: Callable[..., None], *args: Any) -> None:
        """Do work, and report an error."""
        try:
            work(*args)
        except JointIdError as error:
            self._callbacks.problem("samples left out", str(error))
        except Exception as error:  # a bug must not end the thread silently
            self._callbacks.problem("internal error", f"samples left out after {place_of(error)}")

    def _take(self) -> None:
        """Take the samples that wait, and use them."""
        self._working = True
        samples, new_run = self._queue.take()
        if new_run:
            self._identifiers.clear()
            self._presence.end()
            self._origin_ns = None
        if not self._recorded:
            self._forget(self._presence.looked(bool(samples)))
        if samples:
            self._batch = self._given(samples)
            self._use(self._batch)

    def _given(self, samples: Sequence[tuple[int, RawMessage]]) -> _Batch:
        """Give the joints their samples; return the batch of them, of which no joint is begun with yet."""
        (first_ns, first), newest_ns = samples[0], samples[-1][0]
        if self._origin_ns is None:
            self._origin_ns = first.stamp_ns
            self._presence.begin(first_ns)
        new = to_recordings([message for _, message in samples], self._origin_ns, "joint_samples")
        recordings = self._callbacks.completed(new)
        self._identifiers.watch(recordings)
        self._forget(self._presence.named(recordings, newest_ns))
        for joint in self._expected:
            if joint not in recordings:
                have = ", ".join(recordings)
                self._callbacks.problem(
                    "missing joint",
                    f"joint {joint} is not in joint_samples (it has {have}): check parameters joints, set, fix, free",
                )
        wanted = [joint for joint in recordings if not self._wanted or joint in self._wanted]
        for joint in wanted:
            self._identifiers.give(joint, recordings[joint], first_ns, newest_ns)
        return _Batch(deque(wanted), tuple(recordings), self._origin_ns, time.monotonic())

    def _forget(self, joints: Sequence[str]) -> None:
        """End the identification of joints."""
        for joint in joints:
            self._identifiers.forget(joint)
            self._callbacks.gone(joint)

    def _use(self, batch: _Batch) -> None:
        """Fit the joints of a batch until none is left, or until this thread is relieved and others do that."""
        while batch.left and not self._stop.is_set():
            with suppress(IndexError):  # another thread was quicker
                self._guarded(self._identifiers.update, batch.left.popleft(), partial(self._took, batch))
        with self._lock:
            if not self._relay.leads:
                return
            self._batch = None
        if self._recorded:
            self._relay.wait_for_others()
        if not self._stop.is_set():
            self._callbacks.publish()
            self._identifiers.finish(batch.joints)

    def _took(self, batch: _Batch, taken: Taken) -> None:
        """Tell the estimate of a joint."""
        self._longest_lag_s = max(self._longest_lag_s, (self._queue.newest_ns - taken.newest_ns) / NANO)
        if taken.estimate is None or self._stop.is_set():
            return
        self._callbacks.estimated(taken.joint, taken.estimate, batch.origin_ns)
        self._count_missed(taken.samples)
        if batch.long:
            self._callbacks.publish()

    def _count_missed(self, recording: Recording) -> None:
        """Count the hops that the samples of one estimate cover, without gaps, but the first."""
        if recording.duration < 1.4 * self._hop_s:
            return
        covered_s = len(recording) * float(np.median(np.diff(recording.time)))
        with self._lock:
            self.missed += max(0, round(covered_s / self._hop_s) - 1)
