"""CasADi as in `casadi_nlp`, with the noise of the torque as further unknowns, one a sample, weighted by its level.

The joint estimate of parameters, states and disturbance, as CasADi is used for moving horizon estimation. It is
told the level of the noise. Without noise it is `casadi_nlp` itself.
"""

from __future__ import annotations

from collections.abc import Mapping

from peers import casadi_nlp
from peers.model2 import Data, Fit


def fit(data: Data, start: Mapping[str, float], limit_s: float) -> Fit:
    """Fit from `start`, for at most `limit_s` of processor time."""
    return casadi_nlp.fit(data, start, limit_s, data.torque_noise)
