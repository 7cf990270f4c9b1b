"""Follows one joint: every sample passes once through a filter, and blocks of samples are added to a tested memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.block import Block
from joint_id_core.online.change_history import ChangeHistory
from joint_id_core.online.checks import Background, at_once
from joint_id_core.online.learning import Explanation
from joint_id_core.online.levels import Levels
from joint_id_core.online.memory import BLOCK_S, Change, Memory
from joint_id_core.online.newest_innovations import NewestInnovations
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.pending_change import PATIENT, PendingChange
from joint_id_core.online.pending_changes import PendingChanges
from joint_id_core.online.piece import Piece
from joint_id_core.online.refined_memory import RefinedMemory
from joint_id_core.online.tracker import Tracker
from joint_id_core.online.window import SlidingWindow

# Innovation, in standard deviations, from which a sensor jumped: the filter starts again. If it jumps again before it
# has followed a block, it is the joint that changed: the next block is tested.
JUMP = 300.0
# Window lengths of motion without a block for the memory, longer than a change is learned, after which a filter that
# diverges is not started again: it would at every try.
LOST = PATIENT + 1.0
YOUNG = 1.0  # window lengths of motion before which a disagreement is not taken for a change of the joint


class Found(Enum):
    """What the newest samples say of the memory."""

    AGREES = "the memory describes them"
    CHANGING = "they disagree; the new values are not known yet"
    UNEXPLAINED = "no change of parameters explains them"
    WRONG_START = "the first windows disagree with each other, so the first fit found a wrong minimum"


class Follower:
    """Memory and filter of one joint.

    Args:
        memory: what is known.
        coordinates: of the free parameters.
        options: window, forgetting.
        levels: noise levels, which follow the samples.
        make: returns a filter for a recording, at parameters z (k,); None if the recording cannot be used.
        age_s: time of motion in s that is in the memory already.
        background: looks for other minima beside the recursion.

    Attributes:
        tracker: the filter; None while the joint rests.
        found: what the newest samples say.
        since: instant in s at which the change of `explanation`, or a disagreement of the first windows, began.
        age_s: time of motion in s that is in the memory.
        lost_s: time of motion in s since a block was added to the memory.
        astray: whether a label was far from what the filter expected, since the newest block: a sensor jumped, or the
            joint changed.
        tested_from: begin in s of the newest block that agreed with the memory.
        chi2: mean squared normalised innovation of the last window; None before the first block.
        noise_changed: whether the innovations of the last window are far from what the noise levels allow.
    """

    def __init__(
        self,
        memory: Memory,
        coordinates: Coordinates,
        options: OnlineOptions,
        levels: Levels,
        make: Callable[[Recording, Array], Tracker | None],
        age_s: float = 0.0,
        background: Background = at_once,
    ) -> None:
        self.tracker: Tracker | None = None
        self.found = Found.AGREES
        self.since = -np.inf
        self.age_s = age_s
        self.lost_s = 0.0
        self.tested_from = -np.inf
        self.chi2: float | None = None
        self.noise_changed = False
        self._coordinates, self._options, self._make = coordinates, options, make
        self._refined = RefinedMemory(memory, coordinates, options.memory_s, levels, background)
        self._block: Block | None = None  # the present one
        self.astray = False
        self._jumped = False  # whether the filter was stopped since the newest block
        self._innovations = NewestInnovations(options.window_s)
        self._moved_since, self._moved_until = np.inf, -np.inf
        self._pending: PendingChanges | None = None
        self._history = ChangeHistory(coordinates, options)

    @property
    def explanation(self) -> Explanation | None:
        """The newest change that was taken into the memory; None if there is none."""
        return self._history.explanation

    @property
    def sure(self) -> bool:
        """Whether it is a change of the joint, and not of a motion that the model does not describe."""
        return self._history.sure

    @property
    def memory(self) -> Memory:
        """What is known of the parameters."""
        return self._refined.memory

    @property
    def levels(self) -> Levels:
        """What is known of the noise."""
        return self._refined.levels

    def begin(self, tracker: Tracker, pieces: Sequence[Piece]) -> None:
        """Take the pieces of a first window, and the filter that stands at its end."""
        self.tracker = tracker
        for piece in pieces:
            self.memory.add(piece, self._options.memory_s)
            self._history.moved(piece.duration)
        self._refined.learn_all(tracker)

    def rest(self) -> None:
        """End a stretch of motion: the joint rests."""
        self._add_block()
        self._stop()

    def move(self, samples: Recording, window: SlidingWindow) -> None:
        """Follow samples in motion; `window` ends with them.

        A block that becomes full is added by `finish`, or else with the next samples.
        """
        self.finish()
        if self._moved_since == np.inf:
            self._moved_since = float(samples.time[0])
        self.lost_s += float(samples.time[-1]) - max(self._moved_until, float(samples.time[0]))
        self._moved_until = float(samples.time[-1])
        if self.tracker is None:
            self._start(window.recording(self._moved_since))
            return
        if self._block is None:
            self._block = self.tracker.begin()
        ran = self.tracker.run(samples, self._block)
        self.astray = self.astray or bool(self._block.largest[0] > JUMP)
        if not ran:
            self._diverged()
        if not ran or (self.astray and not self._jumped):
            self._jumped = True
            self._stop()

    def finish(self) -> None:
        """Add the present block to the memory once it is long enough.

        This takes twenty times as long as to follow ten samples, and what the block says is in `now` before.
        """
        tracker, block = self.tracker, self._block
        if tracker is not None and block is not None and block.duration > BLOCK_S - 1.5 * tracker.data.period:
            self._add_block()

    def tested(self, samples: Recording) -> tuple[Recording, Recording]:
        """Return samples up to the newest that was tested, and those after it."""
        newest = self.memory.newest
        count = 0 if newest is None else int(samples.time.searchsorted(newest.samples.time[-1], "right"))
        return samples.slice(0, count), samples.slice(count, len(samples))

    def _start(self, recording: Recording) -> None:
        """Start the filter at the estimate of the memory, with the samples since the joint moves."""
        pending = self._pending
        memory = self.memory if pending is None or pending.guess is None else pending.guess[1]
        tracker = self._make(recording, self._coordinates.clip(memory.mean))
        if tracker is None:
            return
        tracker.sharpen(float(np.max(np.sqrt(np.diag(memory.covariance)) / self._coordinates.unit)))
        blocks = tracker.start()
        if blocks:
            self.tracker, self._block = tracker, blocks[-1]
        else:
            self._diverged()

    def _diverged(self) -> None:
        """Take that the filter cannot run at what is known: a guess is dropped, and all of it after a while."""
        if self._pending is not None:
            self._pending.refute()
        if self.lost_s > LOST * self._options.window_s:
            self.found = Found.UNEXPLAINED

    def _stop(self) -> None:
        """Stop the filter: the samples that follow are not those after the last one."""
        self.tracker = self._block = None
        self._moved_since = np.inf

    def now(self) -> tuple[Array, Array]:
        """Return estimate (k,) and covariance (k, k) with the samples of the present block."""
        return self._refined.now(self._block if self.found is Found.AGREES else None)

    # --- blocks

    def _add_block(self) -> None:
        """Add the present block to the memory and test it, or use it to learn what changed."""
        if self.tracker is None or self._block is None:
            return
        if self._block.diverged:
            self._diverged()
            self._stop()
            return
        block, self._block = self.tracker.end(self._block), None
        self._jumped = self.astray = False
        if self.found in (Found.UNEXPLAINED, Found.WRONG_START):
            return
        if self._pending is not None:
            self._pursue(self.tracker, self._pending, self._pending.add(self.tracker, block))
            return
        self.memory.add(block, self._options.memory_s)
        self.lost_s = 0.0
        self._innovations.add(block.white)
        self.chi2 = self._innovations.chi2
        self.age_s += block.duration
        self._history.moved(block.duration)
        change = self._refined.tested(self.tracker)
        if change is None:
            self.tested_from = block.begin.time
            self.noise_changed = self._innovations.noise_changed
            self._refined.learn(self.tracker, block)
        elif self.age_s < YOUNG * self._options.window_s:
            self.found, self.since = Found.WRONG_START, change.blocks[0].begin.time
        else:
            self._begin_change(self.tracker, change)

    # --- changes

    def _begin_change(self, tracker: Tracker, change: Change) -> None:
        """Learn what changed."""
        self.found = Found.CHANGING
        self._pending = self._history.begin(self._refined, tracker, change)
        self._pursue(tracker, self._pending, self._pending.learn(tracker))

    def _pursue(self, tracker: Tracker, pending: PendingChanges, confirmed: PendingChange | None) -> None:
        """Take a change into the memory once it is confirmed."""
        if confirmed is not None:
            self._take(tracker, confirmed)
        elif pending.unexplained:
            self.found = Found.UNEXPLAINED

    def _take(self, tracker: Tracker, confirmed: PendingChange) -> None:
        """Go on with the memory after a change."""
        assert confirmed.guess is not None
        explanation, memory = confirmed.guess
        self._history.take(confirmed)
        self.found, self.since = Found.AGREES, explanation.learned.pieces[0].begin.time
        self._pending = None
        self.lost_s = 0.0
        self._innovations.clear()
        self.chi2 = None
        _, still_known = explanation.change.still_known(self._coordinates.spread)
        self._refined.replace(tracker, memory, explanation.opened, still_known, confirmed.before)
