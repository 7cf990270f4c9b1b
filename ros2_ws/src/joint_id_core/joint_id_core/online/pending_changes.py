"""What may have happened to a joint that does not move as its memory says, until the samples tell."""

from __future__ import annotations

from joint_id_core.online.learning import Explanation
from joint_id_core.online.memory import Memory
from joint_id_core.online.pending_change import PendingChange
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker


class PendingChanges:
    """The joint changed; or an earlier change was another one than it seemed, and explains the newest samples, too.

    What keeps a part of what was known is preferred to new values of all parameters, and one change to two.

    Args:
        tracker: the filter, which ends with the newest block.
        newest: the change that the newest blocks show.
        earlier: a recent one, with all blocks since then; None if there is none.
    """

    def __init__(self, tracker: Tracker, newest: PendingChange, earlier: PendingChange | None) -> None:
        self._newest = newest
        self._changes = [newest] if earlier is None else [earlier, newest]
        self._learn(tracker)

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

    def add(self, tracker: Tracker, block: Piece) -> PendingChange | None:
        """Add the newest block; return the likely change if it confirms that, else learn all from all blocks."""
        likely = self._likely
        confirmed = [change for change in self._changes if change.add(block)]
        if likely in confirmed:
            return likely
        self._learn(tracker)
        return None

    def _learn(self, tracker: Tracker) -> None:
        """Learn the changes, and let the filter go on at the values of the likely one."""
        for change in self._changes:
            change.learn(tracker)
        self._changes = [change for change in self._changes if change.guess is not None or change is self._newest]
        if self.guess is not None and tracker.z is not self.guess[0].learned.z:
            learned = self.guess[0].learned
            tracker.again(learned.pieces, learned.z)
