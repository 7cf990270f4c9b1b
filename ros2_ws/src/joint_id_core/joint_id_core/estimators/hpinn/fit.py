"""The paper's estimator: train the RK4 network on the whole record (reference method).

It simulates from the first labels without feedback (single shooting). So it needs start values within some tens of
percent of the truth, and it assumes that the measured input is exact. `innovations` has neither limit.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.cell.kernel import compile_model, preparing
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.hpinn.estimator import HPinn
from joint_id_core.estimators.shared.fit_data import FitData, UnusableError, options_of, origin_of, prepare, unusable
from joint_id_core.estimators.shared.initial_state import rough_states, start_state
from joint_id_core.estimators.shared.sentences import listed, missed, sentence, times
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.substeps import stable_substeps
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions, Status, Verdict, message
from joint_id_core.results.verdict import MAGNITUDE, NOT_EXCITED_RATIO, PRIOR_RATIO

if TYPE_CHECKING:
    from joint_id_core.estimators.hpinn.network import HPinnNetwork
    from joint_id_core.estimators.hpinn.training import Labels

# The loss has levelled off when its median over the last LEVEL_SHARE of the epochs (at least LEVEL_EPOCHS) is less than
# LEVEL_DROP below its median over the same number of epochs before.
LEVEL_SHARE = 0.1
LEVEL_EPOCHS = 10
LEVEL_DROP = 0.05
POOR_NRMSE = 0.5  # above this nrmse a simulation does not describe the label
STEP_LIMIT = 1.0  # largest |lambda h| of an RK4 step: the error of the fastest mode stays near 1 %
UNSHOWN = 1e-12  # eigenvalues of the scaled Hessian below this, over the largest, count as zero; rounding: 1e-15
MINIMUM_DISTANCE = 1.0  # distance from the minimum, in standard deviations due to noise, above which a message says so


DEFAULTS = HPinn()


def fit_hpinn(
    model: Model,
    recording: Recording,
    settings: ParameterSettings | None = None,
    options: HPinn = DEFAULTS,
    progress: Progress | None = None,
) -> Estimate:
    """Train the H-PINN on a recording.

    The result is the epoch of lowest loss. CONVERGED means that every label is described and that the loss has
    levelled off (`LEVEL_SHARE`, `LEVEL_DROP`). RMSProp often levels off in a narrow valley before the minimum. So the
    covariance has two parts: the covariance of the weighted least-squares minimum, and the square of the Gauss-Newton
    step that is left to this minimum. The first part uses one noise level per label from its residuals, which are
    assumed white.

    Args:
        model: from `models.build`.
        recording: inputs without NaN and at least one measured state.
        settings: values, fixed and freed parameters; this estimator has no priors.
        options: the estimator with its options.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: torch is not installed, NaN in an input, misuse of names, values or bounds, a prior. Poor data
            come back as an `Estimate` with a status.
    """
    begun = clock.perf_counter()
    tell = progress or (lambda _: None)
    from joint_id_core.estimators.hpinn.network import HPinnNetwork  # raises JointIdError if torch is missing
    from joint_id_core.estimators.hpinn.training import LearningRate, make_labels, train

    if settings is not None and settings.priors:
        raise JointIdError(
            f"estimator hpinn has no priors: leave out that of {', '.join(settings.priors)}, or use innovations"
        )
    for name in options.bounds:
        model.parameter(name)
    try:
        data = prepare(model, recording, settings)
    except UnusableError as error:
        return unusable(model, "hpinn", error, recording, settings)
    if data.dropped:
        raise JointIdError(
            f"{recording.source}: {data.dropped} samples have no {' or no '.join(model.input_names)}, and the hpinn "
            "simulates the whole record: cut the record there, or choose the innovations estimator"
        )
    for name in options.bounds:
        if name not in data.free:
            raise JointIdError(f"option bounds: {name} is fixed: free it or leave its interval out")
    labels = make_labels(data, options.torsion_label)
    table_free = {p.name for p in model.parameters if not p.fixed}
    freed = tuple(sorted(set(data.free) - table_free))
    tell(preparing(model, options.friction, freed))
    kernel = compile_model(model, options.friction, freed)
    substeps = options.substeps or stable_substeps(data, kernel, data.p, rough_states(data), STEP_LIMIT)
    start = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    net = HPinnNetwork(model, start, data.free, options.bounds, options.friction, substeps)  # type: ignore[arg-type]  # choices are checked
    x0 = start_state(data)[0]
    rates = LearningRate(options.learning_rate, options.decay_at, options.decay_factor)
    history, finite = train(net, data, labels, x0, options.epochs, rates, tell)
    if not history:
        text = f"{recording.source}: the simulation from the start values is not finite: {Status.DIVERGED.advice}"
        return unusable(model, "hpinn", UnusableError(Status.DIVERGED, text), recording, settings)
    return _estimate(net, data, labels, x0, start, history, finite, clock.perf_counter() - begun)


def _levelled_off(history: list[float]) -> bool:
    share = max(LEVEL_EPOCHS, round(LEVEL_SHARE * len(history)))
    if len(history) <= 2 * share:
        return False
    last, before = np.median(history[-share:]), np.median(history[-2 * share : -share])
    return bool(last >= (1.0 - LEVEL_DROP) * before)


def _minimum(
    jacobian: Array, labels: Labels, weights: Array, residuals: Array, prior: Array
) -> tuple[Array, Array, Array]:
    """Return the covariance at the minimum of the WMSE, the noise of each measured state, and the step to the minimum.

    `jacobian` (T, states, k) is the derivative of the measured states by the parameters. The loss weights labels by
    Eq 2 and not by their noise, and the torsion repeats the noise of the two angles. So the covariance is H^-1 S H^-1
    with the Gauss-Newton Hessian H and the covariance S of the score, not H^-1 alone. The step is a Gauss-Newton step.
    Directions on which the labels have no information keep the standard deviations of the `prior` (k,).
    """
    known = np.isfinite(labels.y)
    by_label = np.einsum("ls,tsk->tlk", labels.mix, jacobian)
    pull = known * (weights**2 / known.sum(0))
    hessian = np.einsum("tl,tlk,tlj->kj", pull, by_label, by_label)
    n = labels.mix.shape[1]
    noise = np.sqrt(np.nanmean(residuals[:, :n] ** 2, axis=0))
    score = np.einsum("tl,tlk,ls,s->tsk", pull, by_label, labels.mix, noise)
    scale = np.sqrt(np.where(np.diag(hessian) > 0.0, np.diag(hessian), 1.0))
    size, axes = np.linalg.eigh(hessian / np.outer(scale, scale))
    shown = size > UNSHOWN * size.max(initial=0.0)
    inverse = (axes[:, shown] / size[shown]) @ axes[:, shown].T / np.outer(scale, scale)
    step = -inverse @ np.einsum("tl,tlk,tl->k", pull, by_label, np.nan_to_num(residuals))
    blind = axes[:, ~shown]
    precision = blind.T @ (blind / (prior * scale)[:, None] ** 2)
    unknown = blind @ np.linalg.inv(precision) @ blind.T / np.outer(scale, scale)
    return inverse @ np.einsum("tsk,tsj->kj", score, score) @ inverse + unknown, noise, step


def _prior(model: Model, name: str, value: float) -> float:
    """Return the prior standard deviation of a parameter."""
    p = model.parameter(name)
    return p.spread * (value if p.positive else 1.0)


def _verdict(model: Model, name: str, value: float, sd: float) -> Verdict:
    ratio = sd / _prior(model, name, value)
    if not ratio <= NOT_EXCITED_RATIO:
        return Verdict.NOT_EXCITED
    magnitude = model.parameter(name).positive and sd > MAGNITUDE * value
    return Verdict.PRIOR if magnitude or ratio > PRIOR_RATIO else Verdict.ESTIMATED


def _estimate(
    net: HPinnNetwork, data: FitData, labels: Labels, x0: Array, start: dict[str, float],
    history: list[float], finite: bool, elapsed: float,
) -> Estimate:  # fmt: skip
    """Simulate with the trained parameters and build the `Estimate`."""
    from joint_id_core.estimators.hpinn.network import label_weights

    model, values = net.model, net.values
    states, sensitivity = net.sensitivities(x0, data.time, data.u)
    free = tuple(name for name in net.trainable if name not in net.at_bound)
    columns = [net.trainable.index(name) for name in free]
    predicted = states[:, labels.states] @ labels.mix.T
    residuals = predicted - labels.y
    jacobian = sensitivity[:, labels.states][:, :, columns]
    prior = np.array([_prior(model, name, values[name]) for name in free])
    covariance, noise, step = _minimum(jacobian, labels, label_weights(labels.y), residuals, prior)
    away = {
        name: abs(d) / s if s > 0 else 0.0 for name, d, s in zip(free, step, np.sqrt(np.diag(covariance)), strict=True)
    }
    covariance = covariance + np.outer(step, step)
    sd = dict(zip(free, np.sqrt(np.diag(covariance)), strict=True))
    found = dict.fromkeys(model.parameter_names, Verdict.FIXED) | dict.fromkeys(net.at_bound, Verdict.AT_BOUND)
    found |= {name: _verdict(model, name, values[name], s) for name, s in sd.items()}
    rows = tuple(
        ParameterEstimate(p.name, p.unit, values[p.name], float(sd.get(p.name, np.nan)), found[p.name], start[p.name])
        for p in model.parameters
    )
    spread = np.nanstd(labels.y, axis=0)
    nrmse = np.sqrt(np.nanmean(residuals**2, axis=0)) / np.where(spread > 0.0, spread, np.nan)
    fit = dict(zip(labels.names, nrmse.tolist(), strict=True))
    flat = np.nan_to_num(residuals)
    lag = np.sum(flat[1:] * flat[:-1], axis=0) / np.maximum(np.sum(flat**2, axis=0), 1e-300)
    status, notes = _judge(history, finite, fit, found, away)
    return Estimate(
        model.name, "hpinn", status, message(notes), rows, notes=notes, free=free, covariance=covariance, nrmse=fit,
        noise=dict(zip(labels.names, noise.tolist(), strict=False)),  # the torsion has no separate noise level
        whiteness=dict(zip(labels.names, lag.tolist(), strict=True)), substeps=net.substeps, iterations=len(history),
        elapsed_s=elapsed, start=float(data.time[0]), end=float(data.time[-1]), samples=len(data.time),
        predictions=Predictions(
            data.time,
            dict(zip(labels.names, labels.y.T, strict=True)),
            dict(zip(labels.names, predicted.T, strict=True)),
            data.inputs,
        ),
        model_options=options_of(model), losses=tuple(history), **origin_of(data.recording),
    )  # fmt: skip


def _judge(
    history: list[float],
    finite: bool,
    nrmse: Mapping[str, float],
    found: Mapping[str, Verdict],
    away: Mapping[str, float],
) -> tuple[Status, tuple[str, ...]]:
    """Return the status, and the findings as sentences, the most useful first."""
    worst = max(nrmse, key=lambda name: np.nan_to_num(nrmse[name]))
    farthest = max(away, key=lambda name: away[name], default="")
    if not finite:
        status = Status.DIVERGED
        said = [f"the simulation left the finite numbers at epoch {len(history)}: values are of the best epoch"]
    elif not _levelled_off(history):
        status = Status.MAX_ITERATIONS
        said = ["the loss still falls: train for more epochs or at a higher learning rate"]
    elif nrmse[worst] > POOR_NRMSE:
        status = Status.POOR_FIT
        said = [missed(f"simulated values of {worst}", nrmse[worst]), Status.POOR_FIT.advice]
    else:
        status, said = Status.CONVERGED, ["the loss has levelled off"]
        if away.get(farthest, 0.0) > MINIMUM_DISTANCE:
            said.append(
                f"training ended {times(away[farthest])} the noise's standard deviation of {farthest} before the "
                "minimum that Gauss-Newton sees, which the standard deviations contain: more epochs or the innovations "
                "estimator help"
            )
    for verdict, words in ((Verdict.AT_BOUND, "at a bound:"), (Verdict.NOT_EXCITED, "this motion does not show")):
        names = [name for name, v in found.items() if v is verdict]
        said += [f"{words} {listed(names)}"] if names else []
    said.append("standard deviations assume white residuals")
    return status, tuple(sentence(text) for text in said)
