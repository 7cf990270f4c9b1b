"""A memory that stays true to its samples: they pass again where the linear memory no longer says what they say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.block import Block
from joint_id_core.online.checks import Background, at_once
from joint_id_core.online.effects import Effects, EffectsBefore
from joint_id_core.online.explained_by_noise import explained_by_noise
from joint_id_core.online.levels import Levels
from joint_id_core.online.memory import Change, Memory
from joint_id_core.online.piece import Piece
from joint_id_core.online.profile_search import ProfileSearch
from joint_id_core.online.relearn import Learned, relearn
from joint_id_core.online.tracker import Tracker

LINEAR = 0.02  # change of a coordinate up to which the result of a block is kept,
LINEAR_SIGMA = 0.3  # or in standard deviations
NEAR = 0.05  # squared standard deviations between these and the estimate, up to which blocks need no further pass
SHARPER = 1.5  # smoothing of friction of a block over that of today up to which its result is kept


class RefinedMemory:
    """A memory with what noise, smooth friction and a likelihood that is no parabola do to it.

    Args:
        memory: what is known.
        coordinates: of its k parameters.
        memory_s: time constant of forgetting.
        levels: noise levels, which follow the samples.
        background: looks for other minima beside the recursion.

    Attributes:
        memory: what is known; replaced by another one when the joint changes.
    """

    def __init__(
        self,
        memory: Memory,
        coordinates: Coordinates,
        memory_s: float,
        levels: Levels,
        background: Background = at_once,
    ) -> None:
        self.memory = memory
        self._coordinates, self._memory_s = coordinates, memory_s
        k = len(coordinates.unit)
        self._nothing = np.zeros((k, k)), np.zeros(k)
        self._shifted = np.zeros(k)  # the mean, by new noise levels, since the blocks were passed
        self._effects = Effects(levels, coordinates.spread, memory_s)
        self._profiles = ProfileSearch(coordinates, memory_s, background)

    @property
    def levels(self) -> Levels:
        """What is known of the noise."""
        return self._effects.levels

    def now(self, block: Block | None) -> tuple[Array, Array]:
        """Return estimate (k,) and covariance (k, k) with the samples of a block that is not complete."""
        memory, wider, unit = self.memory, self._effects.wider, self._coordinates.unit
        bias, excess = self._effects.biases(memory)
        excess = excess + self._profiles.excess(memory.inverse)
        if block is not None:
            mean, covariance, away = memory.with_block(block.matrix, block.vector, wider, bias, excess, block.z, unit)
            if away <= LINEAR:
                return mean, covariance
            # too far for one linear step: wait for the end of the block
        return memory.with_block(*self._nothing, wider, bias, excess, memory.mean, unit)[:2]

    def tested(self, tracker: Tracker) -> Change | None:
        """Test the newest blocks against the memory; return the change that they show.

        The test is linear. Where little is known yet, the blocks may disagree only because of this, and one set of
        parameters describes them all. Or it does once the noise of sensors is reckoned with.
        """
        memory = self.memory
        change = memory.test()
        if change is None:
            return None
        z = tracker.z
        learned = self._relearned(tracker)
        if learned is not None:
            other = memory.copy()
            other.replace(learned.pieces, self._memory_s)
            bias, _ = self._effects.biases(memory)
            if other.test() is None or explained_by_noise(tracker, memory, learned.pieces, bias, self._memory_s):
                self.memory, self._shifted = other, np.zeros_like(self._shifted)
                return None
        tracker.again(memory.blocks[-1:], z)
        return change

    def learn(self, tracker: Tracker, block: Piece) -> None:
        """Learn from a block that was added, and that the memory describes."""
        passed_again = self.refine(tracker)
        self._learn_noise(tracker, self.memory.blocks[-1:] if passed_again else [block], anew=passed_again)
        self._search_on(tracker)

    def learn_all(self, tracker: Tracker) -> None:
        """Learn from all blocks of a first window."""
        self.refine(tracker)
        self._learn_noise(tracker, self.memory.blocks, anew=True)
        self._search_on(tracker)

    def drop(self, change: Change) -> tuple[EffectsBefore, Memory]:
        """Take back the blocks of a change.

        Returns:
            The effects before it, and what was known for sure: the last block before may hold the begin of the change.
        """
        self.memory.drop(len(change.blocks))
        surely = self.memory.copy()
        if surely.blocks:
            surely.drop(1)
        return EffectsBefore(self._effects, self.memory.inverse), surely

    def replace(
        self,
        tracker: Tracker,
        memory: Memory,
        changed: Sequence[int],
        still_known: Array,
        before: EffectsBefore,
    ) -> None:
        """Go on with the memory since a change; `before` as `drop` returned it.

        Noise and friction act on the other parameters as before; what they do to the changed ones is learned from all
        samples since then. The precision of what is `still_known` (k, k) is that of the memory's begin.
        """
        self._effects = before.changed(changed, still_known)
        self.memory, self._shifted = memory, np.zeros_like(self._shifted)
        self._learn_noise(tracker, memory.blocks, anew=False)
        self._profiles = self._profiles.anew()
        self._search_on(tracker)
        self.refine(tracker)

    def refine(self, tracker: Tracker) -> bool:
        """Move the reference to the estimate; if it moved far, pass the newest blocks through the filter again.

        Returns whether they were passed again.
        """
        memory, unit = self.memory, self._coordinates.unit
        mean = self._coordinates.clip(memory.mean)
        sigma = np.sqrt(np.diag(memory.covariance))
        tracker.sharpen(float(np.max(sigma / unit)))
        least = np.maximum(LINEAR * unit, LINEAR_SIGMA * sigma)
        blocks = memory.blocks
        smoothest = max((block.smoothing for block in blocks), default=0.0)
        away = np.abs(np.array([block.z for block in blocks]).reshape(-1, len(mean)) - mean)
        far = np.any(away > least) or np.any(np.abs(self._shifted) > least)
        tracker.move(mean)  # where most often one pass is enough
        return bool(smoothest > SHARPER * tracker.smoothing or far) and self._pass_again(tracker)

    def _learn_noise(self, tracker: Tracker, new: Sequence[Piece], anew: bool) -> None:
        """Learn the noise levels, and what noise of inputs and friction do, from new blocks that the memory describes.

        For `anew` see `Effects.learn`. If levels moved far, what the blocks say is found anew.
        """
        memory, spread = self.memory, self._coordinates.spread
        more = self._effects.learn(tracker, memory, new, anew)
        moved = memory.inverse @ more
        if np.any(np.abs(moved) > spread):  # what hardly a sample tells would go anywhere: this is not linear any more
            moved = np.clip(moved, -spread, spread)
            more = memory.matrix @ moved
        memory.shift(more)
        self._shifted = self._shifted + moved
        far = np.abs(self._shifted) > np.sqrt(np.diag(memory.covariance))
        if np.any(far) or self.levels.moved(memory.blocks):
            self._pass_again(tracker)
        self._effects.apply(memory)

    def _search_on(self, tracker: Tracker) -> None:
        """Go on from a lower minimum, if one was found beside the recursion."""
        lower = self._profiles.run(tracker, self.memory)
        if lower is not None:
            tracker.move(lower)
            self._pass_again(tracker)

    def _pass_again(self, tracker: Tracker) -> bool:
        """Fit the newest blocks again; return whether that was possible."""
        learned = self._relearned(tracker)
        if learned is None:
            return False
        self.memory.replace(learned.pieces, self._memory_s)
        self._shifted = np.zeros_like(self._shifted)
        return True

    def _relearned(self, tracker: Tracker) -> Learned | None:
        """Return the values that suit the newest blocks and what was known before them; None if a path diverges."""
        memory, memory_s = self.memory, self._memory_s
        weights = memory.weights(memory_s)
        return relearn(tracker, memory.blocks, *memory.before(memory_s), weights=weights, near=NEAR)
