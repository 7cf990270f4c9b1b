"""Whether the drive was held between two samples: see `shared.mean_drive`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.filtered import run_through
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.mean_drive import MOST, POSITION, VELOCITY, changes, slope, with_mean_drive
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

# Difference of -2 log likelihood from which one of two descriptions with the same parameters is taken: e^10 to 1.
SURE = 20.0
LIKELY = 1.0  # the same from which it is worth a fit: where parameters make up for a late drive, they hide most of it
BESIDE = 10.0  # the same beside the parameters, of which rounding of an encoder makes small ones
RANK = 1e-10  # of the scaled information matrix: some parameters are not shown at all
OTHERS = (0.25, 0.375, 0.5)  # of every second sample, of every fourth, and of a drive that changes all the time


def takes_mean(model: Model) -> bool:
    """Return whether an estimate with a mean drive can be good: a regression then knows its intervals."""
    return model.stiffness is None and model.torque_drive is not None


def fitted_between(
    estimate: Estimate, model: Model, recording: Recording, fit: Callable[[Recording], Estimate]
) -> Estimate:
    """Return the estimate with the mean drive, if that describes the motion better; else `estimate` as it is.

    Behind a flexible gear, or an inductance, it matters as well when in a step the drive acted, which nobody knows: on
    simulated joints values were still 10 standard deviations off. Such a fit is a poor one.

    Args:
        estimate: of the recording, with the drive held between two samples.
        model, recording: what was fitted.
        fit: makes such an estimate of a recording.
    """
    if model.drive is None or not recording.measured(model.drive) or not np.isfinite(_misfit(estimate)):
        return estimate
    # Three passes at the same parameters nearly always tell that it is held, in a tenth of the time of a fit.
    likely = _most_likely_share(estimate, model, recording)
    if likely == 0.0:
        return estimate
    fits = [(fit(_advanced(model, recording, share)), share) for share in (likely, *OTHERS)]
    earlier, share = min(fits, key=lambda one: _misfit(one[0]))
    if not _misfit(earlier) < estimate.deviance - SURE:
        return estimate
    share = _most_likely_share(earlier, model, recording) or share
    seen = [n for n in model.state_names if recording.measured(n)]
    weights = POSITION if all(n.endswith("_position") for n in seen) else VELOCITY
    best = fit(with_mean_drive(model, recording, share, weights))
    if not _misfit(best) < estimate.deviance - SURE:
        return estimate
    told = sentence(changes(model, share))
    if takes_mean(model):
        notes = (*best.notes[:1], told, *best.notes[1:])
        return replace(best, notes=notes, message=message(notes))
    advised = (told, "Record all samples of the controller, or fit model rigid_joint.")
    alone = best.status is Status.CONVERGED  # else another fault is beside it, or makes the drive look so
    notes = (*advised, *best.notes[1:]) if alone else (*best.notes, *advised)
    return replace(best, status=Status.POOR_FIT, notes=notes, message=message(notes))


def _misfit(estimate: Estimate) -> float:
    """Return -2 log likelihood; inf for a fit that failed."""
    return np.inf if estimate.status.unusable or not np.isfinite(estimate.deviance) else estimate.deviance


def _advanced(model: Model, recording: Recording, share: float) -> Recording:
    """Return a recording whose drive comes a share of a sample earlier."""
    assert model.drive is not None
    drive = recording[model.drive]
    return recording.with_channels({model.drive: drive + share * slope(recording, recording.time, drive)})


def _most_likely_share(estimate: Estimate, model: Model, recording: Recording) -> float:
    """Return by how much of a sample the drive should come earlier, at the parameters of an estimate.

    Innovations are linear in the drive, so their squares are a parabola in the share: three passes tell it. Where these
    parameters make up for a late drive, as viscous friction does, it is its share beside all changes of them that are
    as small. 0 if either is hardly more likely than a drive that is held.
    """
    assert model.drive is not None
    data = prepare(model, recording, ParameterSettings.of_estimate(estimate), leave_out_rests=True)
    kernel, k = compile_model(model, "tanh", data.freed, estimate.cell), model.input_names.index(model.drive)
    more = np.zeros_like(data.u)
    more[:, k] = slope(data.recording, data.time, data.u[:, k])
    recursion, held = run_through(data, kernel, estimate.noise, estimate.substeps)
    half, most = (
        recursion.with_inputs(data.u + share * more).run(held.free, held.levels, held.steps).cost
        for share in (0.5 * MOST, MOST)
    )
    bent = held.cost - 2.0 * half + most
    if not np.isfinite(held.cost):
        return 0.0
    if not (np.isfinite(bent) and bent > 0.0):
        return _share_beside(recursion, held, k, more[:, k])
    share = float(np.clip(0.5 * MOST * (0.5 + (held.cost - half) / bent), 0.0, MOST))
    if 2.0 * bent * (share / MOST) ** 2 > LIKELY:
        return share
    return _share_beside(recursion, held, k, more[:, k])


def _share_beside(recursion: Recursion, held: Pass, channel: int, more: Array) -> float:
    """Return the share by which an input should come earlier if the parameters may change as well; 0 if unlikely."""
    cross, total, score = recursion.disturbances(held, np.array([channel]), more[:, None])
    scale = 1.0 / np.sqrt(np.maximum(held.hessian.diagonal(), 1e-300))
    inverse = np.linalg.pinv(held.hessian * np.outer(scale, scale), rcond=RANK, hermitian=True)
    by = inverse @ (cross[:, 0] * scale)
    told = float(total[0, 0] - by @ (cross[:, 0] * scale))
    size = float(score[0] - by @ (held.gradient * scale)) / max(told, 1e-300)
    return min(size, MOST) if size > 0.0 and size**2 * told > BESIDE else 0.0
