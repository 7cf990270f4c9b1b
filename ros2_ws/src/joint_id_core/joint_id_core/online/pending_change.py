"""A change of the joint whose new values are not known yet."""

from __future__ import annotations

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.learning import Explanation, learn
from joint_id_core.online.memory import BLOCK_S, Change, Memory
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

PATIENT = 4.0  # window lengths of motion after which new values that nothing confirms are given up


class PendingChange:
    """A change that is learned from the samples since it happened.

    It is confirmed when two stretches agree on it: the new values are learned from one, and the next block of samples
    is what they predict.

    Args:
        change: what the memory has found.
        blocks: of samples; the change happened in the first one.
        coordinates: of the free parameters.
        options: window, forgetting.

    Attributes:
        blocks: those so far; the caller appends new ones.
        guess: what may have changed, and the memory that this gives; None if nothing explains the blocks yet.
        unexplained: whether no change of parameters explains them.
    """

    def __init__(self, change: Change, blocks: list[Piece], coordinates: Coordinates, options: OnlineOptions) -> None:
        self.blocks = blocks
        self.guess: tuple[Explanation, Memory] | None = None
        self.unexplained = False
        self._change, self._coordinates, self._options = change, coordinates, options

    def learn(self, tracker: Tracker) -> tuple[Explanation, Memory] | None:
        """Test the guess with the newest block; return it if it is confirmed, else learn it from all blocks."""
        since, window_s, memory_s = self.blocks[1:], self._options.window_s, self._options.memory_s
        if not since:
            return None
        seen_s = sum(block.duration for block in since)
        if self.guess is not None:
            explanation, memory = self.guess
            memory.add(self.blocks[-1], memory_s)
            # Where nothing is kept, new values need a window of motion, as the first ones do.
            enough = not explanation.all_new or seen_s > window_s - BLOCK_S
            if memory.test() is None and enough:
                return self.guess
        found = learn(tracker, since, self._change, self._coordinates)
        self.guess = None
        if found is not None and seen_s < PATIENT * window_s:
            self.guess = found, found.memory(self._coordinates.spread, memory_s)
        elif seen_s > window_s:
            self.unexplained = True
        return None
