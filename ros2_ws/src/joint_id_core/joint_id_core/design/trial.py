"""Trial fits of a planned motion: the bias that a fit will have, by the estimator itself.

One Newton step from the true values tells the bias roughly, enough to compare motions (`Foresight.see`). For a promise
simulated joints make the motion and are fitted. Each is fitted twice, to sensor noise of both signs: the mean of both
errors is the bias, as what is odd in the noise cancels (antithetic variates, Hammersley & Morton, 1956).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.foresight import Foresight
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.correction import with_correction
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict


@dataclass(frozen=True)
class Promise:
    """What fits of a motion will know.

    Attributes:
        covariance: mean square error of the coordinates, shape (k, k): of noise, and of the biases.
        torque: largest torque of the drive of any joint, at the link, in Nm.
        failed: trial fits that found nothing, of how many `tried`.
    """

    covariance: Array
    torque: float
    failed: int
    tried: int


def promise(
    foresight: Foresight, joints: Sequence[Mapping[str, float]], position: Array, velocity: Array
) -> Promise:  # fmt: skip
    """Let joints with these values make a motion (T,) of the link, in rad and rad/s, and fit them.

    Raises:
        JointIdError: the motion is too small or too short for a fit, or no fit found anything.
    """
    total, torque, biases, failed = list[Array](), 0.0, list[Array](), 0
    for joint in joints:
        moved = foresight.move(joint, position, velocity)
        torque = max(torque, moved.torque)
        both = foresight.recordings(moved.recording)
        fits = [trial_fit(foresight, joint, recording) for recording in both]
        known = [estimate for estimate in fits if estimate is not None]
        failed += len(fits) - len(known)
        if len(known) == len(fits):
            biases.append(np.mean([_error(foresight, joint, estimate) for estimate in known], axis=0))
            total.append(foresight.informed(joint, both[0], noise=known[0].noise)[0])
    if not biases:
        raise JointIdError(
            "no trial fit of this motion found the parameters: give the joint's values (--set), or more time"
        )
    covariance = np.mean(total, axis=0) + np.mean([np.outer(bias, bias) for bias in biases], axis=0)
    return Promise(np.asarray(covariance), torque, failed, 2 * len(joints))


def trial_fit(foresight: Foresight, joint: Mapping[str, float], recording: Recording) -> Estimate | None:
    """Return a fit with the integrator steps that it asks for; None if it finds nothing."""
    estimate = fit_innovations(
        foresight.model, recording, foresight.settings, previous=_start(foresight, joint, recording)
    )
    found = not estimate.status.unusable and estimate.free and np.isfinite(list(estimate.values.values())).all()
    # what smoothed friction leaves may look like a torque that the model lacks: then `fit` corrects the values for it
    return with_correction(estimate, foresight.model, foresight.settings) if found else None


def _error(foresight: Foresight, joint: Mapping[str, float], estimate: Estimate) -> Array:
    """Return the error of a fit in coordinates, (k,)."""
    at = foresight.coordinates
    found, true = (at.z(np.array([one[name] for name in foresight.free])) for one in (estimate.values, joint))
    return found - true


def _start(foresight: Foresight, joint: Mapping[str, float], recording: Recording) -> Estimate:
    """Return what is believed of the joint as an estimate that a fit starts from: that spares most of the way.

    It does not start from the true values: a fit that ends where it begins keeps its integrator steps.
    """
    data, levels, stable = foresight.prepared(joint, recording)
    rows = tuple(
        ParameterEstimate(p.name, p.unit, foresight.values[p.name], math.nan, Verdict.ESTIMATED)
        for p in foresight.model.parameters
    )  # fmt: skip
    bounds = NoiseLevels.of(data)
    levels = np.where(levels > bounds.lower, levels, bounds.rough)  # from no noise at all a fit takes long
    return Estimate(
        foresight.model.name, "innovations", Status.CONVERGED, "", rows, data.free,
        noise=dict(zip(data.noise_names, np.sqrt(levels).tolist(), strict=True)), substeps=stable,
    )  # fmt: skip
