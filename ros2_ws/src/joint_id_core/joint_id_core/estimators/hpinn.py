"""The paper's estimator: train the RK4 network on the whole record (reference method).

It simulates from the first labels with no feedback (single shooting), so it needs start values within some
tens of percent, and it takes a measured input for exact. `innovations` has neither limit.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.errors import JointIdError
from joint_id_core.estimate import Estimate, ParameterEstimate, Status, Verdict
from joint_id_core.models import Model
from joint_id_core.options import check, option
from joint_id_core.recording import Array, Recording

if TYPE_CHECKING:
    from joint_id_core.hpinn import HPinn

MIN_SAMPLES = 10
LEVEL_SHARE = 0.1  # the loss has levelled off when its median over this last share of the epochs
LEVEL_DROP = 0.05  # lies less than this part below its median over the share before
POOR_NRMSE = 0.5  # a label whose free-run error exceeds this part of its standard deviation is not described
TORSION = "torsion"  # the extra label dtheta = theta_m / N - q


@dataclass(frozen=True)
class HPinnOptions:
    """Options of the H-PINN. The paper trains for 300 to 1000 epochs; it does not print its learning rates."""

    epochs: int = option(300, "training epochs, each one simulation of the whole record", lower=1)
    learning_rate: float = option(0.01, "RMSProp step at the start, relative to each parameter's start value", lower=0.0)
    decay_at: tuple[float, ...] = option((0.5, 0.75, 0.9), "shares of the epochs at which the learning rate decays")
    decay_factor: float = option(0.3, "factor of each decay of the learning rate", lower=0.0, upper=1.0)
    substeps: int = option(1, "Runge-Kutta steps a sample", lower=1, upper=1000)
    friction: str = option("sign", "direction of Coulomb friction: sign as in the paper, or smoothed", choices=("sign", "tanh"))
    torsion_label: bool = option(True, "add the torsion theta_m/N - q as a label where both angles are measured")
    bounds: str = option("", "intervals of parameters as name=lower:upper, separated by commas")

    def __post_init__(self) -> None:
        check(self)
        if any(not 0.0 < share < 1.0 for share in self.decay_at):
            raise JointIdError(f"option decay_at = {self.decay_at}: shares of the epochs must lie between 0 and 1")

    def intervals(self, model: Model) -> dict[str, tuple[float, float]]:
        """`bounds` by parameter.

        Raises:
            JointIdError: text that is not name=lower:upper, an unknown parameter, or lower above upper.
        """
        found = {}
        for item in filter(None, (part.strip() for part in self.bounds.split(","))):
            name, _, interval = (part.strip() for part in item.partition("="))
            try:
                lower, upper = (float(end) for end in interval.split(":"))
            except ValueError:
                raise JointIdError(f"option bounds: cannot read {item!r}: write name=lower:upper") from None
            if not lower < upper:
                raise JointIdError(f"option bounds: {item!r} is empty: the lower end must be below the upper")
            found[model.parameter(name).name] = (lower, upper)
        return found


@dataclass(frozen=True)
class _Data:
    """What the network is trained on. `mix` (labels, states) maps states to labels, the torsion included."""

    time: Array
    u: Array
    x0: Array
    names: tuple[str, ...]
    labels: Array
    mix: Array
    notes: tuple[str, ...]


def fit_hpinn(
    model: Model,
    recording: Recording,
    values: Mapping[str, float],
    fixed: Collection[str],
    options: HPinnOptions | None = None,
    progress: Callable[[int, int, float], None] | None = None,
) -> Estimate:
    """Train the H-PINN on a recording.

    The result is the epoch of lowest loss. The covariance is that of the weighted least-squares minimum
    (Gauss-Newton, sandwich form) with one noise level a label taken from its residuals; it holds for white residuals.
    CONVERGED means that the loss has levelled off (`LEVEL_SHARE`, `LEVEL_DROP`) and that every label is described.

    Args:
        model: the joint model.
        recording: inputs without NaN; any measured subset of the states as labels.
        values: start values of parameters, SI units; the model's nominal values for those left out.
        fixed: names of the parameters that are held.
        options: see `HPinnOptions`.
        progress: called after each epoch with (epochs done, epochs in all, loss).

    Raises:
        JointIdError: PyTorch is missing, NaN in an input, nothing left to train, or a bad value, name or bound.
    """
    begin = clock.perf_counter()
    options = options or HPinnOptions()
    from joint_id_core.hpinn import HPinn  # needs torch, which is optional

    start = model.values(values)
    for name in fixed:
        model.parameter(name)
    trainable = tuple(name for name in model.parameter_names if name not in fixed)
    if not trainable:
        raise JointIdError(f"all parameters of {model.name} are fixed: free at least one")
    net = HPinn(model, start, trainable, options.intervals(model), options.friction, options.substeps)  # type: ignore[arg-type]  # choices are checked

    def result(status: Status, message: str, rows: dict[str, tuple[float, Verdict]], **fields: object) -> Estimate:
        held = (float("nan"), Verdict.FIXED)
        table = tuple(
            ParameterEstimate(p.name, p.unit, net.values[p.name], *rows.get(p.name, held), initial=start[p.name])
            for p in model.parameters
        )
        span = (float(recording.time[0]), float(recording.time[-1])) if len(recording) else (float("nan"),) * 2
        elapsed = clock.perf_counter() - begin
        return Estimate(
            model.name, "hpinn", status, message, table, start=span[0], end=span[1],
            substeps=options.substeps, elapsed_s=elapsed, **fields,  # type: ignore[arg-type]  # Estimate fields
        )  # fmt: skip

    unknown = dict.fromkeys(trainable, (float("nan"), Verdict.NOT_EXCITED))
    data = _prepare(model, recording, start, options.torsion_label)
    if isinstance(data, tuple):
        return result(*data, unknown)
    history, finite = _train(net, data, options, progress)
    if not np.isfinite(min(history, default=np.nan)):
        cure = "raise substeps (the Runge-Kutta step may be unstable), or check units, N and start values"
        return result(Status.DIVERGED, f"the simulation is not finite: {cure}", unknown, iterations=len(history))

    predicted, jacobian = _predict(net, data)
    free, covariance, noise = _covariance(net, data, predicted, jacobian)
    rows = _verdicts(net, free, covariance)
    nrmse = _nrmse(data, predicted)
    status, message = _judge(history, finite, nrmse)
    notes = [message, *data.notes, "standard deviations assume white residuals"]
    if net.at_bound:
        notes.append(f"at its bound: {', '.join(net.at_bound)}")
    return result(
        status, "; ".join(notes), rows, free=free, covariance=covariance, nrmse=nrmse, noise=noise,
        iterations=len(history), samples=len(data.time), predictions=dict(zip(data.names, predicted.T, strict=True)),
    )  # fmt: skip
