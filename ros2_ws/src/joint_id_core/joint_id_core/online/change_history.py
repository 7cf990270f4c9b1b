"""The changes of a joint that its memory took: the next one may correct or undo one of them."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.curvature import curvature
from joint_id_core.online.learning import Explanation
from joint_id_core.online.memory import Change
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.pending_change import PATIENT, PendingChange
from joint_id_core.online.pending_changes import PendingChanges
from joint_id_core.online.refined_memory import RefinedMemory
from joint_id_core.online.tracker import Tracker

# Blocks of a memory that tell enough of the joint to know it again, and up to which `curvature`, as a standard
# deviation in units of a coordinate: values far along a bent memory would not be those of the joint.
ENOUGH, BENT = 2, 0.1
# Window lengths of motion that what was known must have described before a change, or its new values since, until it is
# told: where the model does not describe all of a motion, as on most real robots, one false change follows another.
BEFORE, SINCE = 4.0, 2.0
UNDOABLE = 3  # changes before which the joint may have been as it is after the next one


class ChangeHistory:
    """Keeps what a next change is compared with.

    Args:
        coordinates: of the free parameters.
        options: window, forgetting.
    """

    def __init__(self, coordinates: Coordinates, options: OnlineOptions) -> None:
        self._coordinates, self._options = coordinates, options
        self._newest: PendingChange | None = None  # that the memory took
        self._settled_s = 0.0  # time of motion in s since then
        self._described_s = 0.0  # the same before it
        self._undoable = deque[PendingChange](maxlen=UNDOABLE)  # the newest one first
        self._next: PendingChange | None = None  # undoable once the memory takes a change

    @property
    def explanation(self) -> Explanation | None:
        """Explanation of the newest change that the memory took; None if there is none."""
        return None if self._newest is None or self._newest.guess is None else self._newest.guess[0]

    @property
    def sure(self) -> bool:
        """Whether the newest change is one of the joint, and not of a motion that the model does not describe."""
        window_s = self._options.window_s
        return self._described_s >= BEFORE * window_s or self._settled_s >= SINCE * window_s

    def moved(self, duration_s: float) -> None:
        """Count motion that the memory describes."""
        self._settled_s += duration_s

    def begin(self, refined: RefinedMemory, tracker: Tracker, change: Change) -> PendingChanges:
        """Take a change back from the memory; return what may have happened.

        This may be one change with a recent one, whose cause was mistaken. Or it undoes an earlier one.
        """
        z, earlier = tracker.z, None
        if self._newest is not None and self._settled_s < PATIENT * self._options.window_s:
            earlier = self._newest.again(refined.memory.blocks)
        before, surely = refined.drop(change)
        more = curvature(tracker, refined.memory, self._coordinates, self._options.memory_s)
        tracker.again(change.blocks[-1:], z)

        def pending(known: Change) -> PendingChange:
            return PendingChange(known, known.blocks, self._coordinates, self._options, before)

        straight = bool(np.all(np.sqrt(np.diag(more)) < BENT * self._coordinates.unit))
        enough = len(surely.blocks) >= ENOUGH and straight
        as_it_was = replace(change, mean=surely.mean, covariance=surely.covariance + more)
        self._next = pending(as_it_was) if enough else None
        newest = pending(replace(change, covariance=change.covariance + more))
        recent = () if self.explanation is None else self.explanation.opened
        return PendingChanges(newest, earlier, self._undoable, recent)

    def take(self, confirmed: PendingChange) -> None:
        """Take the change that samples confirmed."""
        if self._next is not None:
            self._undoable.appendleft(self._next)
        self._newest, self._next = confirmed, None
        self._described_s, self._settled_s = self._settled_s, 0.0
