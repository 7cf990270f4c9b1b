"""What a load that was computed from a description may be off by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FAR_S, FAR = 0.02, 1.5  # s, and steps between its instants, within which a torque is known


class LoadErrors(Protocol):
    """Torques that may be added to a computed load, each with a standard normal factor that holds for the recording."""

    @property
    def of(self) -> str:
        """What they are errors of, in words: the same factors hold for all recordings of it."""

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques in Nm (N where prismatic) at instants (T,) in s, shape (T, m); NaN where not known."""


@dataclass(frozen=True)
class SampledErrors:
    """Errors that are known at some instants.

    Attributes:
        time: instants in s, shape (S,), on the clock of the recording.
        torques: in Nm (N where prismatic), shape (S, m).
        of: see `LoadErrors`.
    """

    time: NDArray[np.float64]
    torques: NDArray[np.float64]
    of: str

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques at other instants (T,), shape (T, m); NaN far from those at which they are known."""
        found = np.full((len(time), self.torques.shape[1]), np.nan)
        if not len(self.time):
            return found
        step = float(np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0
        near = distances(time, self.time) < max(FAR_S, FAR * step)
        for k, column in enumerate(self.torques.T):
            found[near, k] = np.interp(time[near], self.time, column)
        return found


def distances(time: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each instant (T,) how far the nearest of some others is, which increase, in s."""
    later = np.searchsorted(others, time)
    before, after = others[np.maximum(later - 1, 0)], others[np.minimum(later, len(others) - 1)]
    return np.asarray(np.minimum(np.abs(time - before), np.abs(time - after)))
