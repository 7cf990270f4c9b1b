"""The default estimator: the RK4-RNN with innovations feedback (prediction-error method).

Ljung, System Identification (2nd ed., ch. 7) for prediction-error estimation; the cell is the paper's RK4
cell with the previous label as one more input and the Kalman gain on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core import prediction
from joint_id_core.codegen import Kernel, compile_model
from joint_id_core.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.gauss_newton import Minimum, evaluate, minimise
from joint_id_core.estimators.noise import NoiseLevels
from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import input_noise, label_noise
from joint_id_core.estimators.substeps import stable_substeps
from joint_id_core.identifiability import explained, judge, verdicts
from joint_id_core.models import Model
from joint_id_core.options import check, option
from joint_id_core.problem import Problem, UnusableError, prepare, unusable
from joint_id_core.recording import Array, Recording

ANNEALING = (1e6, 1e3)  # input noise times this: feedback from strong to optimal
ANNEALING_SUBSTEPS = 2  # with that feedback a rough step does
MAX_STABLE = 8  # first steps a sample of the last stage; more only where the estimates ask for them
MAX_SUBSTEPS = 64
TOLERANCE = 0.01  # squared length of the last step in standard deviations
STEP_TOLERANCE = 1e-4  # in z: what a finer step may still change where the data know better than that
SAME_COST = 2.0  # two starts that end this near to each other in cost have found the same minimum
EXTRA_STARTS = 6  # when states are not measured, the cost has several minima


@dataclass(frozen=True)
class InnovationsOptions:
    """Options of the innovations estimator."""

    max_iterations: int = option(50, "Gauss-Newton iterations in one stage", lower=1)
    substeps: int = option(0, "RK4 steps a sample; 0 finds them", lower=0, upper=MAX_SUBSTEPS)
    horizon_s: float = option(0.1, "how far ahead the predictions look whose nrmse is reported", "s", lower=0.0)

    def __post_init__(self) -> None:
        check(self)


Progress = Callable[[str], None]


def fit_innovations(
    model: Model,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
    freed: Collection[str] = (),
    options: InnovationsOptions | None = None,
    belief: Belief | None = None,
    previous: Estimate | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Fit a model to a recording.

    Args:
        model: from `models.build`.
        recording: inputs and at least one measured state.
        values: start values (values of fixed parameters) that replace the nominal ones.
        fixed, freed: names to hold although the table frees them, and the other way round.
        belief: prior from earlier data; without it the start values with the spreads of the parameter table.
        previous: a converged estimate of the same joint to start from, without annealing (warm start).
        progress: called with a line of text now and then.

    Raises:
        JointIdError: misuse of names or values. Poor data come back as an `Estimate` with a status.
    """
    begun = time.perf_counter()
    options = options or InnovationsOptions()
    tell = progress or (lambda _: None)
    try:
        problem = prepare(model, recording, values, fixed, freed)
    except UnusableError as error:
        return unusable(model, "innovations", error, recording)
    table_free = {p.name for p in model.parameters if not p.fixed}
    extra = tuple(n for n in problem.free if n not in table_free)
    tell(f"preparing the compiled cell of {model.name}")
    fit = _Fit(problem, compile_model(model, "tanh", extra), options, belief, tell)
    found = fit.warm(previous) if previous is not None and previous.converged else None
    found = found or fit.cold()
    if found is None:
        diverged = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice}")
        return unusable(model, "innovations", diverged, recording)
    return fit.estimate(found, time.perf_counter() - begun)


class _Fit:
    """The stages of one fit on one problem."""

    def __init__(
        self, problem: Problem, kernel: Kernel, options: InnovationsOptions, belief: Belief | None, tell: Progress
    ) -> None:
        self.problem, self.kernel, self.options, self.tell = problem, kernel, options, tell
        self.recursion = Recursion(problem, kernel)
        self.coordinates = Coordinates(problem.model, problem.free)
        self.belief = belief or Belief.before_data(problem)
        self.noise = NoiseLevels.of(problem)
        self.substeps = options.substeps
        self.iterations = 0

    def warm(self, previous: Estimate) -> Minimum | None:
        """Start from a previous estimate of the same quantities; None if it is of others or leads nowhere."""
        levels = np.square(np.array(list(previous.noise.values())))
        if previous.free != self.problem.free or len(levels) != len(self.noise.lower):
            return None
        self.substeps = self.options.substeps or previous.substeps
        z = self.coordinates.z(np.array([previous[n].value for n in previous.free]))
        return self._refined(self._minimised(self.coordinates.clip(z), self.noise.clip(levels)))

    def cold(self) -> Minimum | None:
        """Start from the belief; from others too until one describes the data, or two with unmeasured states."""
        found = self._annealed(self.belief.mean)
        best, steps = found, self.substeps
        twice = len(self.problem.labels) == len(self.problem.model.states)  # one minimum, as a rule
        rng = np.random.default_rng(0)
        for k in range(EXTRA_STARTS):
            if twice and best is not None and not explained(self.problem, best.last.residuals).reasons:
                break
            self.tell(f"start {k + 2} of {EXTRA_STARTS + 1}")
            scatter = 0.5 * self.coordinates.spread * rng.uniform(-1.0, 1.0, len(self.belief.mean))
            other = self._annealed(self.coordinates.clip(self.belief.mean + scatter))
            if other is None:
                continue
            twice = best is not None and (twice or abs(other.cost - best.cost) < SAME_COST)
            if best is None or other.cost < best.cost:
                twice = best is not None and abs(other.cost - best.cost) < SAME_COST
                best, steps = other, self.substeps
        self.substeps = steps
        return best

    def _annealed(self, z: Array) -> Minimum | None:
        """One complete fit from z with rough noise levels: feedback from strong to optimal, then settle."""
        rough = np.concatenate([label_noise(self.problem), input_noise(self.problem)])
        for factor in ANNEALING:
            levels = rough.copy()
            levels[len(self.problem.labels) :] *= factor
            self.substeps = self.options.substeps or self._stable(z, ANNEALING_SUBSTEPS)
            found = minimise(
                self.recursion, self.coordinates, self.belief, self._at(z, levels), self.substeps, 1.0,
                self.options.max_iterations,
            )  # fmt: skip
            if found is None:
                return None
            self.iterations += found.iterations
            z = found.z
        self.substeps = self.options.substeps or self._stable(z, MAX_STABLE)
        return self._refined(self._minimised(z, self.noise.clip(rough)))

    def _stable(self, z: Array, most: int) -> int:
        return stable_substeps(self.problem, self.kernel, self.recursion.values(self.coordinates.values(z)), most=most)

    def _at(self, z: Array, levels: Array, substeps: int = 0) -> Minimum | None:
        return evaluate(self.recursion, self.coordinates, self.belief, z, levels, substeps or self.substeps)

    def _minimised(self, z: Array, levels: Array) -> Minimum | None:
        """Fit parameters and noise levels at the present step size."""
        self.tell(f"fitting parameters and noise levels, {self.substeps} steps a sample")
        found = minimise(
            self.recursion, self.coordinates, self.belief, self._at(z, levels), self.substeps, TOLERANCE,
            self.options.max_iterations, self.noise,
        )  # fmt: skip
        self.iterations += found.iterations if found else 0
        return found

    def _refined(self, found: Minimum | None) -> Minimum | None:
        """More RK4 steps until twice as many would move no estimate by 0.1 sigma, or by 0.01 % where sigma is less.

        What they would do is seen from the gradient of one pass with twice as many steps. Its step is then taken.
        """
        while found is not None and not self.options.substeps:
            finer = self._at(found.z, found.levels, 2 * self.substeps)
            if finer is None:
                return found
            covariance = finer.covariance
            step = covariance @ finer.gradient
            allowed = np.maximum(0.1 * np.sqrt(np.diag(covariance)), STEP_TOLERANCE)
            excess = float(np.max(np.abs(step) / allowed))
            if excess < 1.0 or 2 * self.substeps > MAX_SUBSTEPS:
                return replace(finer, z=self.coordinates.clip(found.z + step), decrement=found.decrement)
            # the error of RK4 falls with the fourth power of the step
            self.substeps = min(MAX_SUBSTEPS, self.substeps * int(np.clip(np.ceil(excess**0.25), 2, 4)))
            found = self._minimised(self.coordinates.clip(found.z + np.clip(step, -1.0, 1.0)), found.levels)
        return found

    def estimate(self, found: Minimum, elapsed: float) -> Estimate:
        """Turn the minimum into an `Estimate`."""
        problem, model = self.problem, self.problem.model
        values = self.coordinates.values(found.z)
        p = self.recursion.values(values)
        covariance_z = found.covariance
        slope = self.coordinates.slope(found.z)
        covariance = covariance_z * np.outer(slope, slope)
        rows = verdicts(model, problem.free, covariance_z, self.coordinates, found.z)
        std = dict(zip(problem.free, np.sqrt(np.diag(covariance)), strict=True))
        initial = dict(zip(model.parameter_names, problem.p, strict=True))
        parameters = tuple(
            ParameterEstimate(q.name, q.unit, float(v), float(std.get(q.name, np.nan)), rows[q.name], initial[q.name])
            for q, v in zip(model.parameters, p, strict=True)
        )
        predictions = prediction.free_runs(
            self.kernel, problem, found.last.states, p, self.substeps, self.options.horizon_s
        )
        nrmse = prediction.nrmse(problem, predictions)
        judged = judge(problem, found, nrmse, rows)
        noisy = (*problem.labels, *(f"input {n}" for n in model.input_names))
        sigma = np.sqrt(found.levels)
        return Estimate(
            model=model.name, estimator="innovations", status=judged.status, message=judged.message,
            parameters=parameters, free=problem.free, covariance=covariance, nrmse=nrmse,
            noise=dict(zip(noisy, map(float, sigma), strict=True)),
            chi2=judged.residuals.chi2, whiteness=judged.residuals.whiteness,
            deviance=found.last.cost, observations=int(np.isfinite(problem.y).sum()),
            substeps=self.substeps, iterations=self.iterations,
            elapsed_s=elapsed, start=float(problem.time[0]), end=float(problem.time[-1]),
            samples=len(problem.time), predictions=predictions,
        )  # fmt: skip
