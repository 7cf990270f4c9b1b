"""One record of a batch, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array


@dataclass(frozen=True)
class Record:
    """What one pass needs of a record. The arguments of `cell.loops.innovations` say more.

    Attributes:
        time: instants in s, shape (T,).
        u: inputs, shape (T, inputs).
        y: labels, shape (T, labels), NaN where missing.
        gap: missing samples before the next one, shape (T,).
        steps: integrator steps to the next sample, shape (T,).
        weight: how often each sample counts, shape (T,): 1, or 0 where labels tell the state only.
        x0, P0, Q_x: start state (n,), its covariance (n, n), variance added to the states per sample (n,).
        restarts: samples at which the state starts again, with mean (n,) and variances (n,).
    """

    time: Array
    u: Array
    y: Array
    gap: Array
    steps: NDArray[np.int64]
    weight: Array
    x0: Array
    P0: Array
    Q_x: Array
    restarts: dict[int, tuple[Array, Array]]
