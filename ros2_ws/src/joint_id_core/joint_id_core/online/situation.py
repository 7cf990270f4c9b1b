"""Where the online identifier stands with one joint, and every way from one situation to the next."""

from __future__ import annotations

from enum import Enum

from joint_id_core.online.follower import Found


class Situation(Enum):
    """Where the online identifier stands. Only STARTING and RESTARTING have no memory."""

    STARTING = "nothing is known: the first window in motion is fitted"
    RESUMED = "an earlier run is continued, and no whole window of today has been seen yet"
    FOLLOWING = "every sample passes through the filter"
    RESTARTING = "the first windows disagreed: the newest window is fitted anew"
    ON_TRIAL = "the samples pass through the filter after a new fit, which counts once enough motion agrees"
    SUSPENDED = "the memory does not describe the newest samples: the newest windows are fitted by themselves"

    @property
    def follows(self) -> bool:
        """Whether samples pass through the filter."""
        return self in (Situation.RESUMED, Situation.FOLLOWING, Situation.ON_TRIAL)

    def after_samples(self, found: Found, agreed: bool) -> Situation:
        """Return what follows from samples that passed through the filter.

        Args:
            found: what they say of the memory.
            agreed: whether the memory holds as much motion as a trial takes.
        """
        if not self.follows:
            return self
        if found is Found.WRONG_START:
            return Situation.RESTARTING
        if found is Found.UNEXPLAINED:
            return Situation.SUSPENDED
        return Situation.FOLLOWING if self is Situation.ON_TRIAL and agreed else self

    def after_window(self, agrees: bool) -> Situation:
        """Return what follows from a whole window that was compared with the memory."""
        return Situation.FOLLOWING if agrees else Situation.SUSPENDED

    def after_fit(self) -> Situation:
        """Return what follows from the fit of a window with which a memory begins."""
        return Situation.FOLLOWING if self is Situation.STARTING else Situation.ON_TRIAL
