"""What a load that was computed from a description may be off by."""

from __future__ import annotations

from collections.abc import Iterable
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


def joined(parts: Iterable[LoadErrors | None]) -> LoadErrors | None:
    """Return the errors of later and later parts of the same samples; None if there are none, or of different loads.

    Parts may share their errors, as those of one recording do.
    """
    known = list({id(one): one for one in parts if one is not None}.values())
    if len(known) < 2 or len({(one.of, one.torques.shape[1]) for one in known}) > 1:
        return known[0] if len(known) == 1 else None
    return LoadErrors(
        np.concatenate([one.time for one in known]), np.concatenate([one.torques for one in known]), known[-1].of
    )
