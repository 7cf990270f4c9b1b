"""Friction after a reversal, which has a memory.

Before a contact slides it yields, as a spring does: after a reversal friction reaches its level only over some distance
(Dahl 1968; Armstrong-Helouvry, Dupont & Canudas de Wit, Automatica 30, 1994). No law of the velocity has that. A fit
without it takes a part for a negative inertia, since a joint that reverses has its largest acceleration.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.regression.lacking import TOLD, with_doubt
from joint_id_core.estimators.regression.least_squares import Solution
from joint_id_core.estimators.shared.hysteresis import hysteresis
from joint_id_core.models import Model

# Distances over which friction turns, as shares of the travel: from 0.5 mrad to 50 mrad on a UR10e.
REACHES = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
# Of what it changes of the inertia, which is in doubt: on simulated joints whose friction turns over 1 to 3 % of the
# travel a tenth is left.
DOUBTED = 0.5
SAID = "after reversals friction turns over some distance, which no law has; the inertia is that beside it"
OF_A_PARAMETER = ("values", "held", "unseen", "unbounded", "sigma", "doubt", "changes", "halves")
MATTERS = 0.1  # least change of friction over its value that puts it in doubt


def turning(motion: Motion, model: Model) -> Array:
    """Return what friction of 1 Nm lacks after reversals, for each distance, shape (T, m).

    No columns for a model without Coulomb friction, or where its position is not a state.
    """
    columns = [np.zeros((len(next(iter(motion.x.values()))), 0))]
    for velocity in model.friction_states:
        position = motion.x.get(velocity.replace("_velocity", "_position"))
        if position is None:
            continue
        direction, travel = np.sign(motion.x[velocity]), float(np.nanmax(position) - np.nanmin(position))
        columns += [(hysteresis(position, reach * travel) - direction)[:, None] for reach in REACHES]
    return np.hstack(columns)


def with_inertia(found: Solution, other: Solution, inertia: NDArray[np.bool_], positive: NDArray[np.bool_]) -> Solution:
    """Return a solution with the inertia of one in which friction has a memory, and with what differs in doubt.

    `inertia` (k,) is True for that parameter, `positive` (k,) for those that cannot be negative.
    """
    apart = np.nan_to_num(np.abs(other.unbounded - found.unbounded))
    matters = positive & (apart > MATTERS * np.abs(found.unbounded))
    doubt = np.where(inertia, DOUBTED * apart, np.where(matters, apart, 0.0))
    before, after = (np.sqrt(np.diag(part.covariance)) for part in (found, other))
    scale = np.where(inertia & np.isfinite(before), after / before, 1.0)
    covariance = found.covariance * np.outer(scale, scale)
    place = np.flatnonzero(inertia & ~np.isfinite(before))  # zero without the memory: nothing is known of correlations
    covariance[place, :] = covariance[:, place] = 0.0
    covariance[place, place] = other.covariance[place, place]
    chosen = {name: np.where(inertia, getattr(other, name), getattr(found, name)) for name in OF_A_PARAMETER}
    turned = replace(found, covariance=covariance, **chosen)
    return with_doubt(turned, doubt, SAID if (doubt > TOLD * np.abs(turned.unbounded)).any() else "")
