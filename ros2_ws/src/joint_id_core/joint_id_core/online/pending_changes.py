"""What may have happened to a joint that does not move as its memory says, until the samples tell."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from joint_id_core.online.learning import Explanation
from joint_id_core.online.memory import Memory
from joint_id_core.online.pending_change import PendingChange
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker


class PendingChanges:
    """The joint changed; or an earlier change was another one than it seemed, and explains the newest samples, too.

    What keeps a part of what was known is preferred to new values of all parameters, and one change to two.

    Args:
        newest: what the memory has found, to be learned.
        earlier: a recent one, with all blocks since then; None if there is none.
        undoable: changes before which the joint may have been as it is now, the newest one first.
        recent: parameters that had just been learned anew, as indices.
    """

    def __init__(
        self,
        newest: PendingChange,
        earlier: PendingChange | None,
        undoable: Sequence[PendingChange],
        recent: Collection[int],
    ) -> None:
        self._newest, self._undoable, self._recent = newest, undoable, recent
        self._changes = [newest] if earlier is None else [earlier, newest]

    @property
    def guess(self) -> tuple[Explanation, Memory] | None:
        """What happened most likely, and the memory that this gives; None if nothing explains the samples yet."""
        return self._likely.guess

    @property
    def unexplained(self) -> bool:
        """Whether no change explains the samples."""
        return all(change.unexplained for change in self._changes)

    @property
    def _likely(self) -> PendingChange:
        return min(self._changes, key=lambda change: (change.guess is None, not change.keeps))

    def refute(self) -> None:
        """Drop the most likely guess, at which the filter diverges."""
        self._likely.guess = None

    def add(self, tracker: Tracker, block: Piece) -> PendingChange | None:
        """Add the newest block; return the change that it confirms, or else what `learn` does."""
        likely = self._likely
        confirmed = [change for change in self._changes if change.add(block)]
        return likely if likely in confirmed else self.learn(tracker)

    def learn(self, tracker: Tracker) -> PendingChange | None:
        """Learn the changes, and let the filter go on at the values of the likely one.

        Args:
            tracker: the filter, which ends with the newest block.

        Returns:
            The change that is undone: the joint is as it was before it. None if there is none.
        """
        for change in self._changes:
            change.learn(tracker)
        self._changes = [change for change in self._changes if change.guess is not None or change is self._newest]
        undone = next(filter(None, (c.undone(tracker, self._newest, self._recent) for c in self._undoable)), None)
        guess = self.guess if undone is None else undone.guess
        if guess is not None and tracker.z is not guess[0].learned.z:
            learned = guess[0].learned
            tracker.again(learned.pieces, learned.z)
        return undone
