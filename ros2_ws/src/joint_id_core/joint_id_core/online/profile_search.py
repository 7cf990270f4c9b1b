"""Profiles of a young memory, found beside the recursion, and what they add to its intervals."""

from __future__ import annotations

from concurrent.futures import Future

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.checks import Background
from joint_id_core.online.likelihood_profile import Axis, Profiles, profiled
from joint_id_core.online.memory import Memory
from joint_id_core.online.tracker import Tracker

AFTER = (4, 8, 16)  # blocks of a memory after which its profiles are found; later little is hardly known
LATER = (32, 64)  # the same while other minima are nearly as likely


class ProfileSearch:
    """Finds the profiles of a memory since its begin, a few times.

    Args:
        coordinates: of the k parameters.
        memory_s: time constant of forgetting.
        background: does the work.
    """

    def __init__(self, coordinates: Coordinates, memory_s: float, background: Background) -> None:
        self._coordinates, self._memory_s, self._background = coordinates, memory_s, background
        self._left = list(AFTER)
        self._running: Future[Profiles | None] | None = None
        self._axes: tuple[Axis, ...] = ()
        self._others: tuple[Array, ...] = ()
        self._apart = np.zeros((len(coordinates.unit), len(coordinates.unit)))  # mean square distance of the others
        self._found: tuple[Array, Array] | None = None  # what `excess` returned, of which inverse

    def anew(self) -> ProfileSearch:
        """Return one for another memory."""
        return ProfileSearch(self._coordinates, self._memory_s, self._background)

    def run(self, tracker: Tracker, memory: Memory) -> Array | None:
        """Start to look for profiles if it is time for that; take those that were found.

        Returns:
            A minimum that is lower than that of the memory, shape (k,), once when it is found.
        """
        count = len(memory.blocks)
        if self._running is None and self._left and count >= self._left[0]:
            self._left = [more for more in self._left if more > count]
            other, then, others = tracker.copy(), memory.copy(), self._others
            self._running = self._background(lambda: profiled(other, then, self._coordinates, self._memory_s, others))
        if self._running is None or not self._running.done():
            return None
        found, self._running = self._running.result(), None
        if found is None:
            return None
        self._axes, self._others, self._found = found.axes, found.others, None
        if self._others:
            self._left = self._left or [more for more in LATER if more > count]
            away = np.array(self._others) - found.z
            self._apart = away.T @ away / len(away)
        else:
            self._apart = np.zeros_like(self._apart)
        return found.z if found.lower else None

    def excess(self, inverse: Array) -> Array:
        """Return what is added to the covariance of the memory, shape (k, k).

        `inverse` (k, k) is that of its information matrix. What bends is of second order: it shrinks with the square of
        the variance along each combination. The distance of other minima stays until they are less likely.
        """
        if self._found is not None and self._found[0] is inverse:
            return self._found[1]
        unit, found = self._coordinates.unit, self._apart.copy()
        for axis in self._axes:
            along = axis.along / unit
            left = min(1.0, float(along @ inverse @ along) / axis.variance)
            found += left * left * axis.excess
        self._found = inverse, found
        return found
