"""The changes of a joint that are published with its estimate."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.follower import Follower
from joint_id_core.online.learning import Explanation
from joint_id_core.online.memory import Change
from joint_id_core.results.estimate import SHOWN, ParameterChange


class Changes:
    """The newest changes of a joint.

    Args:
        free: names of the free parameters; `coordinates`: theirs.
        window_s: changes that are nearer to each other are told together.

    Attributes:
        told: the changes, the most significant first.
    """

    def __init__(self, free: tuple[str, ...], coordinates: Coordinates, window_s: float) -> None:
        self.told: tuple[ParameterChange, ...] = ()
        self._free, self._coordinates, self._window_s = free, coordinates, window_s
        self._explanation: Explanation | None = None  # of the newest one

    def take(self, follower: Follower) -> bool:
        """Take the newest change that the memory took; return whether there is a new one.

        A change that corrects a recent one is told together with it. One back to what was before is told by itself. It
        is sure if the follower is, or if it goes on with a sure one: back to what was before, or the same parameter.
        """
        explanation, since = follower.explanation, follower.since
        if explanation is None:
            return False
        if explanation is self._explanation:
            if follower.sure and not all(c.sure for c in self.told):
                self.told = tuple(replace(c, sure=True) for c in self.told)
            return False
        self._explanation = explanation
        now = follower.memory.mean, follower.memory.covariance
        found = self._found(explanation.undoes or explanation.change, now, since)
        for old in self.told:
            if since - old.since < self._window_s and explanation.undoes is None:
                after, sigma = self._physical(*now)
                j = self._free.index(old.name)
                found[old.name] = replace(old, after=float(after[j]), after_std_dev=float(sigma[j]))
        told = sorted(found.values(), key=attrgetter("size"), reverse=True)
        last = self.told[0] if self.told and self.told[0].sure else None
        goes_on = last is not None and (explanation.undoes is not None or told[0].name == last.name)
        sure = follower.sure or goes_on
        self.told = tuple(replace(c, sure=sure) for c in told if c is told[0] or c.size > SHOWN)
        return True

    def _found(self, change: Change, now: tuple[Array, Array], since: float) -> dict[str, ParameterChange]:
        """Return the parameters that changed; `now` are the coordinates (k,) and their covariance (k, k).

        A parameter whose value had to be learned anew has not always changed: its new value may be the old one.
        """
        z, covariance = now
        before, before_sigma = self._physical(change.mean, change.covariance)
        after, after_sigma = self._physical(z, covariance)
        found = {}
        for j in (*change.names, *change.likely):
            sigma = np.sqrt(covariance[j, j] + change.covariance[j, j])
            if j in change.names or abs(z[j] - change.mean[j]) > SHOWN * sigma:
                was, is_ = (float(before[j]), float(before_sigma[j])), (float(after[j]), float(after_sigma[j]))
                found[self._free[j]] = ParameterChange(self._free[j], *was, *is_, since)
        return found

    def _physical(self, z: Array, covariance: Array) -> tuple[Array, Array]:
        """Return values and standard deviations, shapes (k,), in SI units."""
        return self._coordinates.values(z), self._coordinates.slope(z) * np.sqrt(np.diag(covariance))
