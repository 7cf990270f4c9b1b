"""A change of the joint whose new values are not known yet."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.effects import EffectsBefore
from joint_id_core.online.learning import Explanation, learn
from joint_id_core.online.memory import BLOCK_S, Change, Memory
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.piece import Piece
from joint_id_core.online.returned import returned
from joint_id_core.online.tracker import Tracker

PATIENT = 4.0  # window lengths of motion after which new values that nothing confirms are given up
LONG = 2.0  # window lengths of motion, of which the older half is left out where the newest samples say otherwise


class PendingChange:
    """A change that is learned from the samples since it happened.

    It is confirmed when two stretches agree on it: the new values are learned from one, and the next block of samples
    is what they predict. A small change is found late, in a long stretch, and a joint that warms up changes all the
    time: if the next block is not what a long stretch predicts, new values of all parameters are learned from its newer
    half. What was known before fits none of these values to the last digit, and no single cause explains them.

    Args:
        change: what the memory has found.
        blocks: of samples; the change happened in the first one.
        coordinates: of the free parameters.
        options: window, forgetting.
        before: effects of noise and friction before the change.

    Attributes:
        change: as given.
        guess: what may have changed, and the memory that this gives; None if nothing explains the blocks yet.
        unexplained: whether no change of parameters explains them.
        before: as given.
    """

    def __init__(
        self,
        change: Change,
        blocks: Sequence[Piece],
        coordinates: Coordinates,
        options: OnlineOptions,
        before: EffectsBefore,
    ) -> None:
        self.guess: tuple[Explanation, Memory] | None = None
        self.unexplained = False
        self.before = before
        self._blocks = list(blocks)
        self.change, self._coordinates, self._options = change, coordinates, options
        self._once = True  # whether the joint may have changed once, and not all the time
        self._waited_s = 0.0  # motion in s since it was found

    @property
    def keeps(self) -> bool:
        """Whether a part of what was known explains the samples together with some new values."""
        return self.guess is not None and not self.guess[0].all_new

    @property
    def _seen_s(self) -> float:
        """Motion in s since the change."""
        return sum(block.duration for block in self._blocks[1:])

    def again(self, blocks: Sequence[Piece]) -> PendingChange:
        """Return it with the blocks of the memory that it gave: newer ones may show another cause."""
        return self._with([blocks[0], *blocks])

    def undone(self, tracker: Tracker, newest: PendingChange, recent: Collection[int]) -> PendingChange | None:
        """Return this change with the guess that the joint is as it was before it, if that is what samples show.

        `newest` is the change that these samples show; `recent` are parameters that had just been learned anew, as
        indices.
        """
        if newest.guess is None:
            return None
        instead = newest.guess[0]
        found = returned(tracker, newest._blocks[1:], self.change, newest.change, recent, instead, self._coordinates)
        if found is None:
            return None
        pending = self._with(newest._blocks)
        pending.guess = pending._memory(found)
        return pending

    def _with(self, blocks: Sequence[Piece]) -> PendingChange:
        return PendingChange(self.change, blocks, self._coordinates, self._options, self.before)

    def _memory(self, found: Explanation) -> tuple[Explanation, Memory]:
        return found, found.memory(self._coordinates.spread, self._options.memory_s)

    def add(self, block: Piece) -> bool:
        """Add the newest block; return whether it confirms the guess."""
        self._blocks.append(block)
        self._waited_s += block.duration
        if self.guess is None:
            return False
        explanation, memory = self.guess
        memory.add(block, self._options.memory_s)
        # Where nothing is kept, new values need a window of motion, as the first ones do.
        enough = not explanation.all_new or self._seen_s > self._options.window_s - BLOCK_S
        return memory.test() is None and enough

    def learn(self, tracker: Tracker) -> None:
        """Learn a guess from the blocks.

        If a part of what was known explained them before and nothing does now, the joint may have changed again, in the
        newest block.
        """
        kept, unconfirmed, window_s = self.keeps, self.guess is not None, self._options.window_s
        if unconfirmed and self._seen_s > LONG * window_s:
            self._blocks, self._once = self._blocks[len(self._blocks) // 2 :], False
        found = learn(tracker, self._blocks[1:], self.change, self._coordinates, one_cause=self._once)
        patient, self.guess = self._waited_s < PATIENT * window_s, None
        if found is not None and patient:
            self.guess = self._memory(found)
        elif kept and patient:
            self._blocks = self._blocks[-1:]
        else:
            self.unexplained = self._seen_s > window_s
