"""Verdicts: which parameters the data determine, and whether the model describes the data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.sentences import missed, not_shown, sentence, times
from joint_id_core.models import Model
from joint_id_core.models.operations import ArrayOps
from joint_id_core.results.estimate import ParameterEstimate, Status, message
from joint_id_core.results.verdict import MAGNITUDE, NOT_EXCITED_RATIO, PRIOR_RATIO, STRONG_CORRELATION, Verdict

if TYPE_CHECKING:
    from joint_id_core.estimators.innovations.belief import Coordinates
    from joint_id_core.estimators.innovations.gauss_newton import Minimum

# Lag-one autocorrelation of the innovations beyond which the standard deviations cannot be trusted.
COLOURED = 0.3
# Mean squared normalised innovation beyond which even the largest credible noise does not explain them.
MOST_CHI2 = 1.5
# Correlations that differ by less count as equal.
SAME_CORRELATION = 1e-6
# nrmse of a prediction that is as bad as a constant.
CONSTANT_NRMSE = 1.0


@dataclass(frozen=True)
class Shown:
    """Verdict on one parameter, with the reason in words.

    `together` says what is known instead, if the parameter enters only in combination with others; else it is empty.
    """

    verdict: Verdict
    reason: str
    together: str = ""


def verdicts(
    model: Model,
    free: tuple[str, ...],
    covariance_z: Array,
    coordinates: Coordinates,
    z: Array,
    together: Mapping[str, str] | None = None,
) -> dict[str, Shown]:
    """Return a verdict for every parameter, from the ratio of posterior to prior standard deviation.

    A positive parameter is not `estimated` either while only its order of magnitude is known.

    The prior is the spread in `coordinates` (the model's table, or the user's priors), also after a warm start.
    `together` says, by parameter that enters only in combination, what is known instead.
    """
    deviation = np.sqrt(np.diag(covariance_z))
    correlation = covariance_z / (deviation[:, None] * deviation)
    correlation.flat[:: len(free) + 1] = 0.0
    strength = np.abs(correlation)
    # if several correlations are equal except for rounding, take the first partner in the table
    partners = (strength >= strength.max(axis=1, keepdims=True) - SAME_CORRELATION).argmax(axis=1)
    strongest = correlation[np.arange(len(free)), partners].tolist()
    ratio, bounds = (deviation / coordinates.spread).tolist(), coordinates.at_bound(z).tolist()
    place, held = {name: i for i, name in enumerate(free)}, Shown(Verdict.FIXED, "held at this value")
    found = {}
    for row in model.parameters:
        name, apart = row.name, ""
        if name not in place:
            found[name] = held
            continue
        i = place[name]
        r = ratio[i]
        if abs(strongest[i]) > STRONG_CORRELATION:
            digits = 2 if abs(strongest[i]) < 0.995 else 3
            apart = f"; it is hard to tell from {free[partners[i]]} (correlation {strongest[i]:+.{digits}f})"
        if together and name in together:
            found[name] = Shown(Verdict.PRIOR, together[name], together[name])
        elif bounds[i]:
            end, side = (row.lower, "lower") if z[i] <= coordinates.lower[i] else (row.upper, "upper")
            found[name] = Shown(Verdict.AT_BOUND, f"the data pull it beyond its {side} bound {end:g} {row.unit}")
        elif r > NOT_EXCITED_RATIO:
            found[name] = Shown(Verdict.NOT_EXCITED, f"this motion does not show it{apart}")
        elif r > PRIOR_RATIO:
            text = f"the data narrow what was believed before only {1 / r:.2g} times"
            if row.positive:
                upper = float(coordinates.values(z)[i] * np.exp(2.0 * deviation[i]))
                text += f": it lies below about {upper:.2g} {row.unit}, more is not known"
            found[name] = Shown(Verdict.PRIOR, text + apart)
        elif row.positive and deviation[i] > MAGNITUDE:
            middle, factor = float(coordinates.values(z)[i]), np.exp(2.0 * deviation[i])
            text = f"the data tell only its order of magnitude: it lies between {middle / factor:.2g} and "
            found[name] = Shown(Verdict.PRIOR, f"{text}{middle * factor:.2g} {row.unit}{apart}")
        else:
            often = times(float(f"{1 / r:.1g}"))  # no number that changes with every estimate
            found[name] = Shown(Verdict.ESTIMATED, f"the data narrow what was believed before {often}{apart}")
    return found


def table(
    model: Model, free: tuple[str, ...], p: Array, covariance: Array, rows: Mapping[str, Shown], initial: Array
) -> tuple[ParameterEstimate, ...]:
    """Return the rows of all parameters: values `p`, deviations of the `free` ones, verdicts, start values."""
    std = dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return tuple(
        ParameterEstimate(q.name, q.unit, v, std.get(q.name, math.nan), rows[q.name].verdict, v0, rows[q.name].reason)
        for q, v, v0 in zip(model.parameters, p.tolist(), initial.tolist(), strict=True)
    )


@dataclass(frozen=True)
class Residuals:
    """Statistics of the normalised innovations, and the reasons why they do not look like noise."""

    chi2: float
    whiteness: dict[str, float]
    reasons: tuple[str, ...]


def explained(data: FitData, residuals: Array) -> Residuals:
    """Test normalised innovations (T, labels): mean square and lag-one autocorrelation."""
    observed = sum(len(row) for row in data.rows)
    chi2 = float(np.vdot(residuals, residuals)) / max(1, observed)  # zero without any label
    whiteness = {}
    for k, (name, row) in enumerate(zip(data.labels, residuals.T.copy(), strict=True)):
        e = row if len(data.rows[k]) == len(row) else row[data.present[:, k]]
        energy = float(e @ e)
        whiteness[name] = float(e[1:] @ e[:-1]) / energy if energy > 0 else 0.0
    reasons = []
    worst = max(whiteness, key=lambda n: abs(whiteness[n]))
    if abs(whiteness[worst]) > COLOURED:
        reasons.append(f"the residuals of {worst} are not white (lag-one autocorrelation {whiteness[worst]:.2f})")
    if chi2 > MOST_CHI2:
        reasons.append(f"the prediction errors are {times(np.sqrt(chi2))} what the sensors' noise allows")
    return Residuals(chi2, whiteness, tuple(reasons))


@dataclass(frozen=True)
class Judgement:
    """Status of a fit, the findings as sentences (most useful first), and the residual statistics behind them."""

    status: Status
    notes: tuple[str, ...]
    residuals: Residuals

    @property
    def message(self) -> str:
        """The first notes as one text."""
        return message(self.notes)


def idle_drives(data: FitData, q: Array) -> list[str]:
    """Return a reason for each drive that explains none of the motion.

    That is a drive whose noise variance, in `q` (inputs,), exceeds its own mean square, and that of the torque which
    another drive puts on the same inertia: a load may be small.
    """
    reasons, strength = [], _strength(data)
    powers = np.mean(data.u**2, axis=0)
    for k, (signal, power, variance) in enumerate(zip(data.model.inputs, powers.tolist(), q.tolist(), strict=True)):
        others = max((powers[j] * g[j] ** 2 / g[k] ** 2 for g in strength if g[k] for j in range(len(g))), default=0.0)
        if signal.hold == "zero" and 0.0 < power < variance and others < variance:
            noise, rms = f"{np.sqrt(variance):.2g} {signal.unit}", f"{np.sqrt(power):.2g} {signal.unit}"
            reasons.append(
                f"the recorded {signal.name} (rms {rms}) does not cause this motion (it would need noise of {noise})"
            )
    return reasons


def _strength(data: FitData) -> list[Array]:
    """Return, for every rate of a state, its derivatives by the inputs, shape (inputs,)."""
    model, p = data.model, SimpleNamespace(**dict(zip(data.model.parameter_names, data.p.tolist(), strict=True)))
    none, x = np.zeros(len(model.inputs)), np.zeros(len(model.states))
    base, *more = (
        np.array([float(rate) for rate in model.derivative(list(x), list(u), p, ArrayOps())])
        for u in (none, *np.eye(len(model.inputs)))
    )
    return list(np.array([rates - base for rates in more]).T)


def judge(
    data: FitData,
    found: Minimum,
    nrmse: Mapping[str, float],
    rows: Mapping[str, Shown],
    warnings: Sequence[str] = (),
    doubts: Sequence[str] = (),
) -> Judgement:
    """Decide how the fit ended: converged, not converged, or converged to a model that does not describe the data.

    `warnings` are added to the notes, the most useful first. `doubts` make the fit a poor one.
    """
    residuals = explained(data, found.last.residuals)
    reasons = idle_drives(data, found.levels[len(data.labels) :])
    poor = {n: v for n, v in nrmse.items() if v > CONSTANT_NRMSE}
    if poor:
        worst = max(poor, key=lambda n: poor[n])
        reasons.append(missed(f"the predictions of {worst}", poor[worst]))
    reasons += residuals.reasons
    reasons += doubts
    if not found.settled:
        status, said = Status.MAX_ITERATIONS, [Status.MAX_ITERATIONS.advice, *reasons]
    elif reasons:
        # the advice comes second: the first reason says what is wrong, the others repeat it in other words
        status, said = Status.POOR_FIT, [reasons[0], Status.POOR_FIT.advice]
    elif not informative(data.model, rows):
        status, said = Status.UNINFORMATIVE, [Status.UNINFORMATIVE.advice]
    else:
        status, said = Status.CONVERGED, [Status.CONVERGED.advice]
    notes = [sentence(text) for text in said] + findings(rows, warnings, data.dropped)
    if status is Status.POOR_FIT:
        notes += [sentence(text) for text in reasons[1:]]
    return Judgement(status, tuple(notes), residuals)


def informative(model: Model, rows: Mapping[str, Shown]) -> bool:
    """Return whether the data show a parameter of the joint, or what some are together; an offset is none."""
    of_joint = [shown for n, shown in rows.items() if not model.parameter(n).of_recording]
    return any(shown.verdict is Verdict.ESTIMATED or shown.together for shown in of_joint)


def findings(rows: Mapping[str, Shown], warnings: Sequence[str], dropped: int) -> list[str]:
    """Return the other findings of a fit as sentences, the most useful first: unknown parameters, and `warnings`.

    `warnings` keep their order. `dropped` is the number of samples that were left out.
    """
    said = list(dict.fromkeys(v.together for v in rows.values() if v.together))
    first, *others = [*filter(None, warnings)] or [""]
    unseen = [n for n, v in rows.items() if v.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR) and not v.together]
    said.append(first)
    if unseen:
        said.append(not_shown(unseen))
    said += others
    if dropped:
        said.append(f"{dropped} samples without an input were left out")
    return [sentence(text) for text in said if text]
