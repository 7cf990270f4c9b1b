"""Which signal of a joint with a voltage is late, by the likelihood.

Behind the circuit of a motor a late signal is no shape of a torque, and other parameters can make up for most of it: a
link's encoder that is late by two samples gave four times the damping of a gear, and the fit converged. So every signal
is tried one sample earlier and later by one pass of the filter, of which the parameters take what one step of
Gauss-Newton gives. Where that is far likelier for one signal alone, fits with this signal in other places must agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.filtered import filtered
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.motor_constants import unequal_constants
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

SURE = 20.0  # difference of -2 log likelihood from which a signal may be late: e^10 to 1
EACH = 0.1  # the same a label: less is explained by anything that a model lacks, as friction that sticks
OTHERS = 0.5  # share of that difference below which that of any other signal must be
MOST = 12  # samples by which a signal is late at most
ROUNDS = 3  # of fits, each with the lag that the one before found
RIDGE = 1e-9  # of the scaled information matrix: some parameters are not shown at all


@dataclass(frozen=True)
class _Trial:
    """A recording judged with what an estimate knows."""

    model: Model
    recording: Recording
    estimate: Estimate

    def cost(self, name: str, late: int, step: bool = True) -> float:
        """Return -2 log likelihood a label, with a signal that is taken to be `late` samples late.

        It is that after a `step` of Gauss-Newton, or that of the estimate itself. The samples at both ends, which only
        some of these recordings have, are left out.
        """
        recording = corrected(self.recording, name, late)
        data = prepare(self.model, recording, ParameterSettings.of_estimate(self.estimate), leave_out_rests=True)
        kernel = compile_model(self.model, "tanh", data.freed, self.estimate.cell)
        (found,) = filtered(data, kernel, self.estimate.noise, self.estimate.substeps)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(found.hessian), 1e-300))
        g = scale * found.gradient
        H = found.hessian * np.outer(scale, scale) + RIDGE * np.eye(len(g))
        gained = float(g @ np.linalg.solve(H, g)) if step else 0.0
        cost = (found.cost - gained) / max(int(data.present.sum()), 1)
        return float(cost) if np.isfinite(cost) else np.inf

    def least(self, name: str, lags: range) -> int:
        """Return the lag that is likeliest, in samples."""
        return min(lags, key=lambda late: self.cost(name, late))


def with_late_signal(
    estimate: Estimate, model: Model, recording: Recording, fit: Callable[[Recording], Estimate]
) -> Estimate:
    """Return the estimate of a model with a voltage, as a poor one if a signal is late; others as they are.

    Args:
        estimate: of the recording.
        model, recording: what was fitted.
        fit: makes such an estimate of a recording.
    """
    if model.drive is None or model.torque_drive is not None or not np.isfinite(estimate.deviance):
        return estimate
    if estimate.status.unusable or len(recording) < 8 * MOST:
        return estimate
    try:
        told = _late_signal(estimate, model, recording, fit)
    except JointIdError:
        return estimate
    if not told:
        return estimate
    notes = (sentence(told), *estimate.notes[estimate.status is Status.CONVERGED :])
    return estimate.noted(notes, status=Status.POOR_FIT)


def corrected(recording: Recording, name: str, late: int) -> Recording:
    """Return a recording with a signal that was `late` samples late, without `MOST` samples at both ends."""
    moved = recording.with_channels({name: np.roll(recording[name], -late)})
    return moved.slice(MOST, len(recording) - MOST)


def _late_signal(estimate: Estimate, model: Model, recording: Recording, fit: Callable[[Recording], Estimate]) -> str:
    """Return in words which signal is late or early; empty if none is, or several may be."""
    trial, labels = _Trial(model, recording, estimate), estimate.observations
    names = [n for n in (*model.state_names, model.drive or "") if recording.measured(n)]
    if len(names) < 2:
        return ""
    before = trial.cost(names[0], 0)
    gains = {(n, late): labels * (before - trial.cost(n, late)) for n in names for late in (-1, 1)}
    name, way = max(gains, key=lambda key: gains[key])
    others = [gain for (n, _), gain in gains.items() if n != name]
    if gains[name, way] < SURE or max(*others, 0.0) > OTHERS * gains[name, way] or gains[name, -way] > 0.0:
        return ""
    late = trial.least(name, range(way, way * MOST, way))
    for _ in range(ROUNDS):
        found = fit(corrected(recording, name, late))
        trial = _Trial(model, recording, found)
        if not trial.cost(name, late, step=False) < before:  # such fits take long
            return ""
        last, late = late, trial.least(name, range(max(late - 2, 1 - MOST), min(late + 3, MOST)))
        if late == last:
            break
    if late == 0 or found.status is not Status.CONVERGED:
        return ""
    if before - trial.cost(name, late, step=False) < EACH:
        return ""
    if unequal_constants(model, found):  # swapped channels, for example
        return ""
    return _text(name, late, recording.period)


def _text(name: str, late: int, period: float) -> str:
    samples = f"{abs(late)} sample{'s' if abs(late) > 1 else ''}"
    size = f"{1e3 * abs(late) * period:.2g} ms ({samples}) {'late' if late > 0 else 'early'}"
    return f"{name} is about {size} against the other signals: correct its times"
