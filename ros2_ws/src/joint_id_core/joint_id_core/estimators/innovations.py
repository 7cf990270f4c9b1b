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
from joint_id_core.codegen import CELLS, Kernel, compile_model
from joint_id_core.errors import JointIdError
from joint_id_core.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.gauss_newton import Minimum, evaluate, minimise
from joint_id_core.estimators.misfit import misfit
from joint_id_core.estimators.noise import NoiseLevels
from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import rough_states
from joint_id_core.estimators.substeps import fastest_mode, stable_substeps, steps_of
from joint_id_core.identifiability import explained, judge, verdicts
from joint_id_core.models import Model
from joint_id_core.options import check, option
from joint_id_core.problem import Problem, UnusableError, prepare, unusable
from joint_id_core.recording import Array, Recording
from joint_id_core.rk4 import Steps
from joint_id_core.structure import combinations

STRONGEST, STRONG = 1e6, 1e4  # first input noise over its rough level: the feedback of the previous labels
STRONG_SUBSTEPS = 2  # with that feedback a rough step does
MAX_SUBSTEPS = 64
TOLERANCE = 0.01  # squared length of the last step in standard deviations
STEP_TOLERANCE = 1e-4  # in z: what a finer step may still change where the data know better than that
SAME_STEPS = (
    0.02  # shift of an estimate in spreads of its prior (5 % of a positive one) that leaves the steps as they are
)
SAME_COST = 2.0  # two starts that end this near to each other in cost have found the same minimum
EXTRA_STARTS = 6  # when states are not measured, the cost has several minima


@dataclass(frozen=True)
class InnovationsOptions:
    """Options of the innovations estimator."""

    max_iterations: int = option(50, "Gauss-Newton iterations in one stage", lower=1)
    substeps: int = option(0, "steps a sample; 0 finds them", lower=0, upper=MAX_SUBSTEPS)
    cell: str = option("rk4", "Runge-Kutta 4, or an implicit method for stiff joints", choices=CELLS)
    priors: str = option(
        "", "standard deviations known before any data, NAME=SD separated by commas; relative for positive parameters"
    )
    horizon_s: float = option(0.1, "how far ahead the predictions look whose nrmse is reported", "s", lower=0.0)

    def __post_init__(self) -> None:
        check(self)

    def known(self, problem: Problem) -> dict[str, float]:
        """`priors` by parameter.

        Raises:
            JointIdError: text that is not NAME=SD, a parameter that is held, a deviation that is not positive.
        """
        found = {}
        for item in filter(None, (part.strip() for part in self.priors.split(","))):
            name, _, text = (part.strip() for part in item.partition("="))
            try:
                deviation = float(text)
            except ValueError:
                raise JointIdError(f"option priors: cannot read {item!r}: write NAME=SD, e.g. k_t=0.05") from None
            if not 0.0 < deviation < np.inf:
                raise JointIdError(f"option priors: {item!r}: a standard deviation is finite and above zero")
            if problem.model.parameter(name).name not in problem.free:
                raise JointIdError(f"option priors: {name} is held: free it (--free {name}) or leave its prior out")
            found[name] = deviation
        return found


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
    fit = _Fit(problem, compile_model(model, "tanh", extra, options.cell), options, belief, tell)
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
        self.coordinates = Coordinates(problem.model, problem.free, options.known(problem))
        self.belief = belief or Belief.before_data(problem, self.coordinates)
        self.noise = NoiseLevels.of(problem)
        self.rough_states = rough_states(problem)
        self.substeps = options.substeps
        self.steps = np.empty(0, dtype=np.int64)
        self.iterations = 0

    def warm(self, previous: Estimate) -> Minimum | None:
        """Start from a previous estimate of the same quantities; None if it is of others or leads nowhere."""
        levels = np.square(np.array(list(previous.noise.values())))
        if previous.free != self.problem.free or len(levels) != len(self.noise.lower):
            return None
        self.substeps = self.options.substeps or previous.substeps
        z = self.coordinates.clip(self.coordinates.z(np.array([previous[n].value for n in previous.free])))
        levels = self.noise.clip(levels)
        self.steps = steps_of(self.problem, self.kernel, self._values(z), self.rough_states, self.substeps)
        self._choose_start(z, levels)
        found = self._minimised(z, levels, self.rough_states)
        if found is not None and float(np.max(np.abs(found.z - z) / self.coordinates.spread)) < SAME_STEPS:
            return found  # the step size was judged for these values
        return self._refined(found)

    def cold(self) -> Minimum | None:
        """Start from the belief; from others too until one describes the data, or two with unmeasured states."""
        found = self._annealed(self.belief.mean)
        best, steps = found, (self.substeps, self.steps)
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
                best, steps = other, (self.substeps, self.steps)
        self.substeps, self.steps = steps
        if best is not None and self._choose_start(best.z, best.levels):
            best = self._minimised(best.z, best.levels, best.last.states)
        return self._refined(best)

    def _annealed(self, z: Array) -> Minimum | None:
        """One fit from z with rough noise levels and the first step size: feedback from strong to optimal.

        Where every state is measured the noise levels, fitted along, weaken the feedback by themselves as fast as the
        parameters come closer; unmeasured states need parameters that are not far off before that.
        """
        rough, states = self.noise.rough, self.rough_states
        inputs = np.arange(len(rough)) >= len(self.problem.labels)
        if len(self.problem.labels) < len(self.problem.model.states):
            start = self._started(z, np.where(inputs, STRONGEST * rough, rough), states, even=True)
            found = minimise(
                self.recursion, self.coordinates, self.belief, start, self.steps, 1.0, self.options.max_iterations
            )
            if found is None:
                return None
            self.iterations += found.iterations
            z, states = found.z, found.last.states
        start = self._started(z, self.noise.clip(np.where(inputs, STRONG * rough, rough)), states)
        return self._continued(start)

    def _started(self, z: Array, levels: Array, states: Array, even: bool = False) -> Minimum | None:
        """A first pass with as many steps as the fastest mode needs at z, or more if the path blows up.

        `states` (T, n) tell where friction turns; with `even` every sample has the same steps, few of them.
        """
        first = self.options.substeps or self._stable(z)
        for substeps in (first,) if self.options.substeps else (first, 4 * first, 16 * first):
            self.substeps = substeps
            if even:
                self.steps = np.full(len(self.problem.time), max(min(first, STRONG_SUBSTEPS), substeps // 2))
            else:
                self.steps = steps_of(self.problem, self.kernel, self._values(z), states, substeps)
            start = self._at(z, levels, self.steps)
            if start is not None:
                return start
        return None

    def _choose_start(self, z: Array, levels: Array) -> bool:
        """Start the record from the twist under its first load if that is likelier; whether it is.

        For a motor position that is not measured. So it is in a window that begins in motion, and is not in one that
        begins with a jump of the drive.
        """
        if "motor_position" not in set(self.problem.model.state_names) - set(self.problem.labels):
            return False
        self.recursion.start_near(None)
        relaxed = self._at(z, levels, self.steps)
        self.recursion.start_near(self._values(z))
        loaded = self._at(z, levels, self.steps)
        if loaded is not None and (relaxed is None or loaded.cost < relaxed.cost):
            return True
        self.recursion.start_near(None)
        return False

    def _values(self, z: Array) -> Array:
        return self.recursion.values(self.coordinates.values(z))

    def _stable(self, z: Array) -> int:
        if self.options.cell == "implicit":
            return 1
        return stable_substeps(self.problem, self.kernel, self._values(z), self.rough_states, sliding=True)

    def _at(self, z: Array, levels: Array, steps: Steps) -> Minimum | None:
        return evaluate(self.recursion, self.coordinates, self.belief, z, levels, steps)

    def _minimised(self, z: Array, levels: Array, states: Array) -> Minimum | None:
        """Fit with the present steps a sample; `states` (T, n) tell where friction turns."""
        self.steps = steps_of(self.problem, self.kernel, self._values(z), states, self.substeps)
        return self._continued(self._at(z, levels, self.steps))

    def _continued(self, start: Minimum | None) -> Minimum | None:
        """Fit parameters and noise levels from a first pass with the present steps."""
        self.tell(f"fitting parameters and noise levels, {self.substeps} steps a sample")
        found = minimise(
            self.recursion, self.coordinates, self.belief, start, self.steps, TOLERANCE, self.options.max_iterations,
            self.noise,
        )  # fmt: skip
        self.iterations += found.iterations if found else 0
        return found

    def _refined(self, found: Minimum | None) -> Minimum | None:
        """More steps a sample until twice as many move no estimate by 0.1 sigma, or by 0.01 % where sigma is less.

        What they would do is seen from the gradient of one pass with twice as many steps. Its step is then taken, and
        stands for the error that is left.
        """
        while found is not None and not self.options.substeps:
            finer = self._at(found.z, found.levels, 2 * self.steps)
            if finer is None:
                return found
            covariance = finer.covariance
            step = covariance @ finer.gradient
            allowed = np.maximum(0.1 * np.sqrt(np.diag(covariance)), self._least)
            excess = float(np.max(np.abs(step) / allowed))
            if excess < 1.0 or 2 * self.substeps > MAX_SUBSTEPS:
                z = self.coordinates.clip(found.z + np.clip(step, -1.0, 1.0))
                return replace(finer, z=z, decrement=found.decrement, integration=step)
            # the error of a method of order four falls with the fourth power of the step
            self.substeps = min(MAX_SUBSTEPS, self.substeps * int(np.clip(np.ceil(excess**0.25), 2, 4)))
            z = self.coordinates.clip(found.z + np.clip(step, -1.0, 1.0))
            found = self._minimised(z, found.levels, finer.last.states)
        return found

    @property
    def _least(self) -> Array:
        """Change of each coordinate that is never worth a finer step."""
        return STEP_TOLERANCE * np.where(self.coordinates.positive, 1.0, self.coordinates.spread)

    def _step_warning(self, found: Minimum) -> str:
        """What to say of an integration error that matters; nothing where it does not."""
        share = np.abs(found.integration) / np.sqrt(np.diag(np.linalg.inv(found.hessian)))
        matters = (np.abs(found.integration) > self._least) & (share > 0.1)
        if 2 * self.substeps <= MAX_SUBSTEPS or not matters.any():
            return ""
        worst = int(np.argmax(share * matters))
        mode = fastest_mode(self.problem, self.kernel, self._values(found.z), self.rough_states, sliding=False)
        text = (
            f"{self.substeps} steps a sample are too few: twice as many would move {self.problem.free[worst]} by "
            f"{share[worst]:.2g} standard deviations, which its own now contains (fastest mode {-mode:.4g} 1/s)"
        )
        return text + ("; use the implicit cell (--cell implicit)" if self.options.cell == "rk4" else "")

    def _combinations(self, values: dict[str, float], covariance: Array) -> dict[str, str]:
        """By parameter that enters only in combination, what is known instead."""
        problem, model = self.problem, self.problem.model
        zero = {name for name, u in zip(model.input_names, problem.u.T, strict=True) if not np.any(u)}
        zero |= {name for name in model.parameter_names if name not in problem.free and values[name] == 0.0}
        known: dict[str, str] = {}
        for group in combinations(model, problem.free, frozenset(zero)):
            value = group.value(values, problem.free, covariance)
            unit = f" {model.parameter(group.names[0]).unit}" if group.kind == "sum" else ""
            text = group.text if value is None else f"{group.text} = {value[0]:.6g} ± {value[1]:.2g}{unit}"
            known |= dict.fromkeys(group.names, text)
        return known

    def estimate(self, found: Minimum, elapsed: float) -> Estimate:
        """Turn the minimum into an `Estimate`."""
        problem, model = self.problem, self.problem.model
        values = self.coordinates.values(found.z)
        p = self.recursion.values(values)
        missing = misfit(self.recursion, self.coordinates, found, self.steps)
        covariance_z = found.covariance + np.outer(missing.bias, missing.bias)
        slope = self.coordinates.slope(found.z)
        covariance = covariance_z * np.outer(slope, slope)
        known = self._combinations(dict(zip(model.parameter_names, p.tolist(), strict=True)), covariance)
        rows = verdicts(model, problem.free, covariance_z, self.coordinates, found.z, known)
        std = dict(zip(problem.free, np.sqrt(np.diag(covariance)), strict=True))
        initial = dict(zip(model.parameter_names, problem.p, strict=True))
        parameters = tuple(
            ParameterEstimate(
                q.name,
                q.unit,
                float(v),
                float(std.get(q.name, np.nan)),
                rows[q.name].verdict,
                initial[q.name],
                rows[q.name].reason,
            )
            for q, v in zip(model.parameters, p, strict=True)
        )
        predictions = prediction.free_runs(
            self.kernel, problem, found.last.states, p, self.steps, self.options.horizon_s
        )
        nrmse = prediction.nrmse(problem, predictions)
        judged = judge(problem, found, nrmse, rows, (missing.text, self._step_warning(found)))
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
