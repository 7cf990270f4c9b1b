"""What the identifier knows of the joints, beyond the end of a run and of the process."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.stored.state_file import Known
from joint_id_core.stored.state_store import StateStore

Make = Callable[[str, Recording], OnlineIdentifier]  # from the name of a joint and its first samples

SET_BACK_S = 60.0  # a clock that was set back by more tells nothing of the time that passed
REST_S = 10.0  # time between two writes while joints rest: only the time until which they were watched is new


@dataclass(frozen=True)
class Restored:
    """Knowledge of an earlier run that this one continues: the estimate as of now, and the time since then in s."""

    estimate: Estimate
    origin_ns: int
    gone_s: float
    text: str

    @property
    def newest(self) -> Estimate:
        """A window of today without a sample."""
        end, nan = self.estimate.end + self.gone_s, float("nan")
        return replace(
            self.estimate, status=Status.TOO_SHORT, message=self.text, notes=(self.text,), start=end, end=end,
            samples=0, chi2=nan, iterations=0, elapsed_s=0.0,
        )  # fmt: skip


class StoredKnowledge:
    """The newest good estimate of every joint, stored in a file if there is one.

    A new run continues from it. Threads may call `continued`, `add` and `gone` at the same time.

    Attributes:
        store: the file.
    """

    def __init__(self, problem: Callable[[str, str], None], clock: Callable[[], float] = time.time) -> None:
        """Begin without knowledge.

        Args:
            problem: called with kind and text of a problem with the file, or of knowledge that cannot be used.
            clock: wall clock in s since 1970.
        """
        self._problem, self._clock = problem, clock
        self._lock = threading.RLock()
        self._known: dict[str, Known] = {}
        self._settings: dict[str, dict[str, Any]] = {}  # of the identifiers of this run
        self._waiting: set[str] = set()  # joints whose knowledge a new identifier continues
        self._restored: dict[str, Restored] = {}  # of joints without a good estimate in this run
        self._refused: dict[str, str] = {}  # why a joint is identified anew, until it is
        self._good: dict[str, tuple[int, Estimate]] = {}  # newest good estimate of this run, with its origin
        self.store = StateStore(self._content, problem, clock)

    # --- runs

    def begin(self, joints: Collection[str], possible: Callable[[str], Iterable[OnlineIdentifier]]) -> None:
        """Begin a run with what is known of `joints`, or of all if there are none.

        `possible` returns the identifiers that a joint may get; if none can continue what is known of it, this is said,
        and the joint starts anew.
        """
        with self._lock:
            self.forget_run()
            for joint in self._known:
                if joints and joint not in joints:
                    continue
                try:
                    self._restored[joint] = self._resume(joint, possible(joint))
                    self._waiting.add(joint)
                except JointIdError as error:
                    self._refuse(joint, error)

    def forget_run(self) -> None:
        """Forget which joints this run knows: those of the next samples start anew."""
        with self._lock:
            for part in (self._waiting, self._restored, self._refused, self._good):
                part.clear()

    def good(self) -> dict[str, Estimate]:
        """Return the newest good estimate of this run by joint."""
        with self._lock:
            return {joint: estimate for joint, (_, estimate) in self._good.items()}

    @property
    def restored(self) -> Mapping[str, Restored]:
        """What this run continues, of joints of which it has no good estimate of its own yet."""
        with self._lock:
            return self._restored.copy()

    @property
    def refused(self) -> list[str]:
        """Sentences on joints that start anew although something was known of them, until they are identified."""
        with self._lock:
            return list(self._refused.values())

    def continued(self, make: Make, joint: str, samples: Recording) -> OnlineIdentifier:
        """Make the identifier of a joint, given its first samples, and let it continue what is known of the joint."""
        identifier = make(joint, samples)
        with self._lock:
            self._settings.pop(joint, None)
            if identifier.remembers:
                self._settings[joint] = _plain(identifier.settings)
            if joint not in self._waiting or joint not in self._known:
                return identifier
            self._waiting.discard(joint)
            try:
                self._restored[joint] = self._resume(joint, [identifier])
            except JointIdError as error:
                self._restored.pop(joint, None)
                self._refuse(joint, error)
        return identifier

    def add(self, joint: str, estimate: Estimate, origin_ns: int) -> Estimate | None:
        """Take an estimate of the present run; return the newest good one, on the same clock, or None."""
        with self._lock:
            now_s = self._clock()
            restored = self._restored.get(joint)
            if estimate.converged:
                self._restored.pop(joint, None)
                self._refused.pop(joint, None)
                self._good[joint] = origin_ns, estimate
                if (settings := self._settings.get(joint)) is not None:
                    kept = estimate if estimate.predictions is None else estimate.updated(predictions=None)
                    self._put(joint, Known(kept, origin_ns, now_s, settings))
            elif restored is not None and joint not in self._good and math.isfinite(estimate.start):
                # its times are those of an earlier clock: count back from the first sample
                end = estimate.start - restored.gone_s
                then = replace(restored.estimate, start=end + restored.estimate.start - restored.estimate.end, end=end)
                self._good[joint] = origin_ns, then
            origin, good = self._good.get(joint, (origin_ns, None))
            if origin != origin_ns:  # it belongs to the previous run, perhaps of another robot
                return None
            known = self._known.get(joint)
            rests = good is not None and estimate.status is Status.NO_MOTION
            if rests and known is not None and now_s - known.watched_s > REST_S:
                as_of_now = known.estimate if restored is None else restored.estimate
                self._put(joint, replace(known, estimate=as_of_now, watched_s=now_s))
            return good

    def gone(self, joint: str) -> None:
        """Note that a joint is not in the samples any more; if it returns, it continues."""
        with self._lock:
            self._restored.pop(joint, None)
            if self._good.pop(joint, None) is not None:
                self._waiting.add(joint)

    def _resume(self, joint: str, identifiers: Iterable[OnlineIdentifier]) -> Restored:
        """Let the first of the identifiers that can continue what is known of a joint.

        Raises:
            JointIdError: why none can.
        """
        known, problem = self._known[joint], JointIdError("there is no model for it")
        gone_s = self._clock() - known.watched_s
        if gone_s < -SET_BACK_S:
            raise JointIdError(f"the clock of this computer was set back by {-gone_s:.0f} s, so its age is not known")
        gone_s = max(0.0, gone_s)
        for identifier in identifiers:
            try:
                if (now := _plain(identifier.settings)) != known.settings:
                    names = ", ".join(sorted(n for n in now if now[n] != known.settings.get(n)))
                    raise JointIdError(f"the settings are others now ({names})")
                estimate = identifier.resume(known.estimate, gone_s)
            except JointIdError as error:
                problem = error
            else:
                source = f"from {self.store.path}, " if self.store.path else ""
                text = f"Restored {source}{gone_s:.1f} s old: not tested by new samples yet."
                return Restored(estimate, known.origin_ns, gone_s, text)
        raise problem

    def _refuse(self, joint: str, error: JointIdError) -> None:
        text = f"joint {joint} is identified anew, because what was known of it cannot be used: {error}"
        self._refused[joint] = text
        self._problem("knowledge not used", text)

    # --- the file

    def open(self, path: str) -> None:
        """Keep what is known in the file of this path from now on; none if it is empty.

        If it is another file than before and exists, what it holds replaces what is known. A problem is reported.
        """
        if known := self.store.open(path):
            with self._lock:
                self._known = known

    def load(self) -> str:
        """Take what the file holds in place of what is known; return a sentence.

        Raises:
            JointIdError: there is no file, or it cannot be used; what is known stays.
        """
        known = self.store.read()
        with self._lock:
            self._known = known
        return f"loaded {_count(known)} from {self.store.path}"

    def save(self) -> str:
        """Write the file now; return a sentence.

        Raises:
            JointIdError: it cannot be written, or no file is given.
        """
        path = self.store.save()
        return f"saved {_count(self._known)} to {path}"

    def reset(self) -> str:
        """Forget every joint, and delete the file; return a sentence.

        Raises:
            JointIdError: the file cannot be deleted.
        """
        with self._lock:
            text = f"forgot {_count(self._known)}"
            self.forget_run()
            self._known.clear()
        path = self.store.remove()
        return text if path is None else f"{text} and deleted {path}"

    def _put(self, joint: str, known: Known) -> None:
        self._known[joint] = known
        self.store.ask()

    def _content(self) -> dict[str, Known]:
        with self._lock:
            return self._known.copy()


def _count(joints: Collection[object]) -> str:
    return f"{len(joints)} joint{'' if len(joints) == 1 else 's'}"


def _plain(settings: ParameterSettings) -> dict[str, Any]:
    """Return settings as they come back from a JSON file."""
    return {n: sorted(v) if isinstance(v, tuple) else dict(v) for n, v in asdict(settings).items()}
