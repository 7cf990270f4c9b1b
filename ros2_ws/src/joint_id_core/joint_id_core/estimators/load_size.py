"""The size of a computed load, where it is all that tells the torques of a joint.

With a torque constant that is free, no torque is measured. Then the load gives the torque constant and with it all
stiffnesses, inertias and frictions, and they are known no better than the masses of the description.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.estimators.shared.intervals import with_covariance
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.models import Model
from joint_id_core.models.combinations import combinations
from joint_id_core.results.estimate import Estimate

SIZE_ERROR = 0.2  # share of a load by the masses of a description, where no motion is there to tell more
SAID = "No torque is measured"


def size_deviation(recordings: Sequence[Recording], factors: Array | None, width: float) -> float:
    """Return the standard deviation of the size of a load as a share of it, by what its description may be off by.

    Args:
        recordings: with the computed load, and its errors.
        factors: of the errors that were added to the load, shape (m,); None if none were.
        width: standard deviation of the factors.
    """
    used = [(one, one.load_errors) for one in recordings if one.load_errors is not None and LOAD in one]
    if not used:
        return 0.0
    errors = np.concatenate([of.at(one.time + 0.5 * one.period) for one, of in used])
    load = np.concatenate([one[LOAD] for one, _ in used])
    known = np.isfinite(errors).all(axis=1) & np.isfinite(load)
    added = np.zeros(errors.shape[1]) if factors is None else factors
    whole = added + np.linalg.lstsq(errors[known], load[known], rcond=None)[0]  # factors that make all of the load
    if not (length := float(np.linalg.norm(whole))):
        return 0.0
    return float(np.hypot(width, whole @ added / length)) / length  # factors that were added ask for another size, too


def with_size_doubt(model: Model, estimate: Estimate, share: float) -> Estimate:
    """Return an estimate whose torques are known no better than the size of the load, if nothing else tells them.

    One that says so already stays as it is.

    Args:
        model: of the estimate.
        estimate: from recordings with a computed load.
        share: standard deviation of the size of the load as a share of it.
    """
    if not share or not estimate.free or estimate.status.unusable or any(n.startswith(SAID) for n in estimate.notes):
        return estimate
    zero = {p.name for p in estimate.parameters if p.name not in estimate.free and p.value == 0.0}
    groups = combinations(model, estimate.free, frozenset({LOAD, *zero}))
    scaled = next((group.names for group in groups if group.kind == "scale"), ())
    if not scaled:
        return estimate
    moved = share * np.array([estimate[name].value * (name in scaled) for name in estimate.free])
    wider = with_covariance(model, estimate, estimate.covariance + np.outer(moved, moved))
    told = f"{SAID}: {listed(scaled)} are known no better than the load, {100.0 * share:.0f} %"
    notes = (*wider.notes[:1], sentence(told), *wider.notes[1:])
    return wider.noted(notes)
