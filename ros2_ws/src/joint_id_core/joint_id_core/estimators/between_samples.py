"""Whether the drive was held between two samples: see `shared.mean_drive`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.lateness import lateness
from joint_id_core.estimators.one_encoder import SHOWS
from joint_id_core.estimators.regression.missing import COMPLIANCE
from joint_id_core.estimators.shared.mean_drive import LEAST, MOST, POSITION, VELOCITY, changes, slope, with_mean_drive
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

# Difference of -2 log likelihood from which one of two descriptions with the same parameters is taken: e^10 to 1.
SURE = 20.0
MUCH = 3.0  # rms changes of the drive in a sample, from which its noise has other causes than what it did within
FITS = 3  # most of them until the share is known
OTHERS = (0.25, 0.375, 0.5)  # of every second sample, of every fourth, and of a drive that changes all the time


def takes_mean(model: Model) -> bool:
    """Return whether an estimate with a mean drive can be good: a regression then knows its intervals."""
    return model.stiffness is None and model.torque_drive is not None


class Fit(Protocol):
    """Makes an estimate of a recording; its search may begin at a previous one."""

    def __call__(self, *, recording: Recording, previous: Estimate) -> Estimate: ...


def fitted_between(estimate: Estimate, model: Model, recording: Recording, fit: Fit) -> tuple[Estimate, float]:
    """Return the estimate with the mean drive, if that describes the motion better, and the share of the next sample.

    Else it is `estimate` with a share of 0; its intervals contain that the drive may not have been held.

    Behind a flexible gear, or an inductance, it matters as well when in a step the drive acted, which nobody knows: on
    simulated joints values were still 10 standard deviations off. Such a fit is a poor one.

    Args:
        estimate: of the recording, with the drive held between two samples.
        model, recording: what was fitted.
        fit: makes such an estimate.
    """
    if model.drive is None or not recording.measured(model.drive) or not np.isfinite(_misfit(estimate)):
        return estimate, 0.0
    # Three passes at the same parameters nearly always tell that it is held, in a tenth of the time of a fit.
    late = lateness(estimate, model, recording)
    if late is None:
        return estimate, 0.0
    if late.likely == 0.0 or not _small(estimate, model.drive, recording) or _cannot_be_why(estimate, model, recording):
        return late.contained(estimate, model), 0.0
    tried = [(estimate, 0.0)]
    for share in (late.likely, *OTHERS):
        best = min(tried, key=_of_fit)[0]
        tried.append((fit(recording=_advanced(model, recording, share), previous=best), share))
    earlier, share = min(tried, key=_of_fit)
    if not _misfit(earlier) < estimate.deviance - SURE:
        return late.contained(estimate, model), 0.0
    left = lateness(earlier, model, recording)
    share = share if left is None else min(max(left.likely, left.beside), MOST) or share
    best = fit(recording=described(model, recording, share), previous=earlier)
    if not _misfit(best) < estimate.deviance - SURE:
        return late.contained(estimate, model), 0.0
    if takes_mean(model):
        exact, share = _with_exact_share(best, model, share, fit, partial(described, model, recording))
        return (exact, share) if share >= LEAST else (late.contained(estimate, model), 0.0)
    told = sentence(changes(model, share))
    advised = (told, "Record all samples of the controller, or fit model rigid_joint.")
    alone = best.status is Status.CONVERGED  # else another fault is beside it, or makes the drive look so
    notes = (*advised, *best.notes[1:]) if alone else (*best.notes, *advised)
    return best.noted(notes, status=Status.POOR_FIT), 0.0


def described(model: Model, recording: Recording, share: float) -> Recording:
    """Return what an estimate describes: the recording, with the mean drive if the next sample has a share of it."""
    if not share > 0.0:
        return recording
    seen = [n for n in model.state_names if recording.measured(n)]
    weights = POSITION if all(n.endswith("_position") for n in seen) else VELOCITY
    return with_mean_drive(model, recording, share, weights)


def _with_exact_share(
    estimate: Estimate, model: Model, share: float, fit: Fit, meant: Callable[[float], Recording]
) -> tuple[Estimate, float]:  # fmt: skip
    """Return the estimate and the share that are most likely together: parameters made up for a part of it before.

    Its intervals contain that the share is not known exactly.

    Args:
        estimate: with the mean drive of a `share` near that.
        model: what was fitted.
        fit: makes an estimate of a recording.
        meant: makes the recording with the mean drive of a share.
    """
    left = lateness(estimate, model, meant(share))
    for _ in range(FITS):
        if left is None or abs(left.beside) < left.sigma:
            break
        nearer = float(np.clip(share + left.beside, 0.0, MOST))
        again = fit(recording=meant(nearer), previous=estimate)
        if not np.isfinite(_misfit(again)):
            break
        estimate, share = again, nearer
        left = lateness(estimate, model, meant(share))
    if left is not None:
        estimate = left.share_contained(estimate, model)
    notes = (*estimate.notes[:1], sentence(changes(model, share)), *estimate.notes[1:])
    return estimate.noted(notes), share


def _small(estimate: Estimate, drive: str, recording: Recording) -> bool:
    """Return whether the noise that the drive needs is one that its changes between samples can make.

    A model that is wrong otherwise needs more, and each of its fits takes long.
    """
    noise = estimate.noise.get(f"input {drive}", 0.0)
    return noise**2 < MUCH**2 * float(np.nanmean(slope(recording, recording.time, recording[drive]) ** 2))


def _cannot_be_why(estimate: Estimate, model: Model, recording: Recording) -> bool:
    """Return whether a regression tells that a flexible joint does not fit badly for what its drive did in a sample.

    Whatever the drive did, such a fit stays a poor one, and each further one takes as long. As that of a rigid joint,
    inverse dynamics describe the motion then, and show neither that the drive changes between samples nor that the gear
    yields. Nothing is told of a load that drifts, which a rigid joint does not have.
    """
    drifts = "drifting_load" in model.state_names
    poor = estimate.status in (Status.POOR_FIT, Status.MAX_ITERATIONS)
    if not poor or takes_mean(model) or model.torque_drive is None or drifts:
        return False
    from joint_id_core.estimators.regression.as_rigid import regressed_as_rigid  # loads SciPy

    try:
        rigid = regressed_as_rigid(recording, estimate.values)
    except JointIdError:
        return False
    if rigid is None:
        return False
    fitted = rigid.fitted[0]
    late = fitted.share is not None and fitted.share.sure
    return not (late or fitted.fault or fitted.blind or fitted.helps[COMPLIANCE] >= SHOWS)


def _misfit(estimate: Estimate) -> float:
    """Return -2 log likelihood; inf for a fit that failed."""
    return np.inf if estimate.status.unusable or not np.isfinite(estimate.deviance) else estimate.deviance


def _of_fit(tried: tuple[Estimate, float]) -> float:
    return _misfit(tried[0])


def _advanced(model: Model, recording: Recording, share: float) -> Recording:
    """Return a recording whose drive comes a share of a sample earlier."""
    assert model.drive is not None
    drive = recording[model.drive]
    return recording.with_channels({model.drive: drive + share * slope(recording, recording.time, drive)})
