"""Bootstrap of a fit: how far estimates scatter when parts of the record count more or less.

The weighted likelihood bootstrap (Newton and Raftery, Approximate Bayesian Inference with the Weighted Likelihood
Bootstrap, JRSS B 56, 1994): every block of samples gets a random weight, and the record is fitted again. The motion
stays as it was; a simulation with new noise would leave it, since no controller holds the joint. It does not assume
that the innovations are white within a block, nor that the noise levels are right, as the standard deviations do.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.belief import Belief
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import estimate_of
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum
from joint_id_core.estimators.innovations.noise import unknown_levels
from joint_id_core.estimators.innovations.search import Outcome
from joint_id_core.estimators.innovations.stages import TOLERANCE
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import TorchPasses, require_device
from joint_id_core.estimators.many.problem import searched
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate

DEFAULTS = Innovations()
FEWEST = 20  # draws that still give an interval
LEVEL = 0.95  # of the intervals


@dataclass(frozen=True)
class Interval:
    """What the draws say of one parameter, SI units.

    Attributes:
        name, unit, value, std_dev: of the estimate. Its deviation also contains what the record cannot tell by itself:
            errors that the model may have, integration, noise of sensors of inputs.
        noise: the part of this deviation that is due to noise; the scatter should agree with it.
        scatter: standard deviation of the draws.
        bias: mean of the draws minus the minimum of the record itself.
        lower, upper: ends of the 95 % interval: quantiles of the draws.
    """

    name: str
    unit: str
    value: float
    std_dev: float
    noise: float
    scatter: float
    bias: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of a record whose blocks count more or less, at random.

    Attributes:
        estimate: of the record itself.
        intervals: one for each free parameter.
        draws: values of the free parameters, shape (draws that settled, k).
        failed: draws without a minimum.
        block_s: length of the blocks in s.
        device: where the passes ran.
        elapsed_s: time in s, without the fit of the record.
    """

    estimate: Estimate
    intervals: tuple[Interval, ...]
    draws: Array
    failed: int
    block_s: float
    device: str
    elapsed_s: float

    def to_dict(self) -> dict[str, object]:
        """Return all but the draws as JSON-ready values."""
        return {
            "source": self.estimate.source, "draws": len(self.draws), "failed": self.failed, "block_s": self.block_s,
            "device": self.device, "elapsed_s": self.elapsed_s, "parameters": [vars(i) for i in self.intervals],
        }  # fmt: skip

    def __str__(self) -> str:
        said = f"{len(self.draws)} draws of {self.estimate.source}"
        said += f", in blocks of {self.block_s:g} s"
        said += f"; {self.failed} more had no minimum" if self.failed else ""
        lines = [
            said,
            f"{'parameter':<12} {'value':>12} {'std_dev':>10} {'by noise':>10} {'of draws':>10}   95 % of the draws",
        ]
        for i in self.intervals:
            each = f"{i.std_dev:10.2g} {i.noise:10.2g} {i.scatter:10.2g}"
            lines.append(f"{i.name:<12} {i.value:12.5g} {each}   {i.lower:.5g} to {i.upper:.5g} {i.unit}")
        return "\n".join(lines)


def bootstrap(
    model: Model,
    recording: Recording,
    settings: ParameterSettings | None = None,
    draws: int = 200,
    block_s: float = 0.05,
    device: str = "cpu",
    seed: int = 0,
    estimator: Innovations = DEFAULTS,
    progress: Progress | None = None,
) -> Bootstrap:
    """Fit a recording, and again with random weights of its blocks, from the minimum on. Needs torch.

    The prior takes part as a measurement: each draw has another prior mean. So the scatter compares with the standard
    deviations of the estimate, which contain the prior as well.

    Args:
        model, recording, settings: as in `fit`.
        draws: how many fits.
        block_s: length of the blocks in s: longer than the correlation of the innovations.
        device: "cpu" or "cuda" (a GPU): the same results.
        seed: of the draws.
        estimator: options of the engine.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: misuse of names or values, data that cannot be fitted, a device that is not there, torch is not
            installed, fewer than 20 draws or draws that settle, a record of fewer than 20 blocks.
    """
    if draws < FEWEST:
        raise JointIdError(f"draws = {draws}: an interval needs {FEWEST} or more")
    device = "torch" if device == "cpu" else device
    require_device(device, estimator.cell)
    tell, begun = progress or (lambda _: None), time.perf_counter()
    outcome = searched(model, recording, settings, estimator, tell)
    estimate = estimate_of(outcome, begun)
    stages, found = outcome.stages, outcome.minimum
    data, belief, rng = stages.data, stages.cost.belief, np.random.default_rng(seed)
    block = max(1, round(block_s / data.period))
    if not (block_s > 0.0 and FEWEST * block <= len(data.time)):
        most = data.period * (len(data.time) // FEWEST)
        raise JointIdError(f"block_s = {block_s:g}: give a time above 0, for this record at most {most:.3g} s")
    begun = time.perf_counter()
    blocks = np.arange(len(data.time)) // block
    weights = rng.exponential(size=(draws, blocks[-1] + 1))
    spread = np.linalg.cholesky(np.linalg.inv(belief.precision))
    jobs = []
    for j in range(draws):
        prior = Belief(belief.names, belief.mean + spread @ rng.standard_normal(len(found.z)), belief.precision)
        cost = Cost(stages.recursion, stages.coordinates, prior)
        jobs.append(Start(j, cost, stages.scoring, found.z, found.levels))
    recursions, steps = [stages.recursion] * draws, [found.last.steps] * draws
    passes = TorchPasses(recursions, steps, device, weights[:, blocks])
    ends = minimised(passes, jobs, [found.substeps] * draws, TOLERANCE, estimator.max_iterations, tell)
    settled = [end for end in ends if end is not None and end.settled]
    if len(settled) < FEWEST:
        raise JointIdError(
            f"{recording.source}: only {len(settled)} of {draws} draws have a minimum: this fit is not well determined"
        )
    return _bootstrap(estimate, outcome, settled, draws - len(settled), block_s, device, time.perf_counter() - begun)


def _bootstrap(
    estimate: Estimate, outcome: Outcome, ends: list[Minimum], failed: int, block_s: float, device: str, elapsed: float
) -> Bootstrap:
    at, data = outcome.stages.coordinates, outcome.stages.data
    values = np.array([at.values(end.z) for end in ends])
    found, recursion = outcome.minimum, outcome.stages.recursion
    middle = at.values(found.z)
    last = recursion.renewed(found.last)
    known = recursion.noise_information(last, with_parameters=True)
    of_levels = unknown_levels(found.inverse, known.matrix, known.cross * at.slope_at(last.free)[:, None])
    noise = np.sqrt(np.diag(found.inverse + of_levels)) * at.slope(found.z)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = np.quantile(values, [tail, 1.0 - tail], axis=0)
    intervals = []
    for k, name in enumerate(data.free):
        row = estimate[name]
        intervals.append(Interval(
            name, row.unit, row.value, row.std_dev, float(noise[k]), float(values[:, k].std(ddof=1)),
            float(values[:, k].mean() - middle[k]), float(lower[k]), float(upper[k]),
        ))  # fmt: skip
    return Bootstrap(estimate, tuple(intervals), values, failed, block_s, device, elapsed)
