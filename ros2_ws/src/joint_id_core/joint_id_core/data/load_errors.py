"""What a load that was computed from a description may be off by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LoadErrors:
    """Torques that may be added to a computed load, each with a standard normal factor that holds for the recording.

    Attributes:
        time: instants in s, shape (S,), on the clock of the recording.
        torques: in Nm (N where prismatic), shape (S, m).
        of: what they are errors of, in words: the same factors hold for all recordings of it.
    """

    time: NDArray[np.float64]
    torques: NDArray[np.float64]
    of: str

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques at other instants (T,), shape (T, m)."""
        return np.array([np.interp(time, self.time, column) for column in self.torques.T]).reshape(-1, len(time)).T
