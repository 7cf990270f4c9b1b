"""The stages of a fit: from start values to the minimum of the innovations cost, with enough integrator steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.estimator import MAX_SUBSTEPS, Innovations
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum, minimise
from joint_id_core.estimators.innovations.likelihood_search import most_likely, passes_each
from joint_id_core.estimators.innovations.noise import NoiseLevels, NoiseScoring
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.innovations.verdicts import explained
from joint_id_core.estimators.shared.substeps import stable_substeps, steps_of
from joint_id_core.options import Progress

STRONG_SUBSTEPS = 2  # with strong feedback few integrator steps are enough
TOLERANCE = 0.1  # squared length of the last step in standard deviations
NEAR = 4.0  # the same before a later pass that shows the distance that is left
# Fall of the cost with finer steps that matters. Were all of it along one shape that the tests of the residuals know,
# that would be found with its root, four standard deviations.
FALLS = 16.0
# Integrator steps a sample after which a search ends that has not found what describes the motion. Simulated flexible
# joints were found in 20 to 3,100; on logs of stiff joints of robots (100 to 250 Hz) none was in up to 95,000.
MOST_WORK = 5000
STALLED = 1.0  # distance to the solution in standard deviations from which an iteration counts as stalled
STEP_TOLERANCE = 1e-4  # in z: accepted integration error, even if the standard deviation is smaller


@dataclass
class Effort:
    """Computing effort of a fit so far, a counter shared by all its stages.

    Attributes:
        iterations: iterations of all stages.
        work: integrator steps in all iterations of the stages.
        searched: integrator steps in the searches for the maximum of the likelihood.
        spent: integrator steps of both, on excerpts of the record, too.
    """

    iterations: int = 0
    work: int = 0
    searched: int = 0
    spent: int = 0


class Stages:
    """The stages of fitting one record. Each method takes a start point and returns the point where it ended.

    Attributes:
        cost: the cost to minimise.
        tolerance: default of the squared length, in standard deviations, of the last step of a stage.
        effort: computing effort of all stages.
    """

    def __init__(
        self,
        cost: Cost,
        options: Innovations,
        noise: NoiseLevels,
        rough_states: Array,
        tell: Progress,
        effort: Effort | None = None,
    ) -> None:
        self.cost, self.options, self.noise, self.rough_states, self.tell = cost, options, noise, rough_states, tell
        self.recursion, self.coordinates = cost.recursion, cost.coordinates
        self.data, self.kernel = self.recursion.data, self.recursion.kernel
        self.scoring = NoiseScoring(self.recursion, noise)
        self.tolerance = TOLERANCE if options.substeps else NEAR
        self.effort = effort or Effort()

    def of_part(self, first: int, length: int) -> Stages | None:
        """Return the stages for a part of the record, with their own effort; None if a label has no value there."""
        part = self.data.part(first, first + length)
        if not np.isfinite(part.y).any(axis=0).all():
            return None
        cost = replace(self.cost, recursion=Recursion(part, self.kernel))
        return Stages(cost, self.options, self.noise, self.rough_states[first : first + length], self.tell)

    def started_near(self, p: Array | None) -> Stages:
        """Return the same stages, with start states for parameters `p` near the truth: see `Recursion`."""
        cost = replace(self.cost, recursion=self.recursion.started_near(p))
        return Stages(cost, self.options, self.noise, self.rough_states, self.tell, self.effort)

    def steps(self, z: Array, states: Array, substeps: int) -> Steps:
        """Return the steps of each sample, shape (T,): `substeps`, more at friction reversals in `states` (T, n)."""
        return steps_of(self.data, self.kernel, self.cost.values(z), states, substeps)

    def at(self, z: Array, levels: Array, states: Array, substeps: int) -> Minimum | None:
        """Run one pass with `substeps` steps per sample, more at friction reversals in `states` (T, n)."""
        return self.cost.at(z, levels, self.steps(z, states, substeps), substeps)

    def started(self, z: Array, levels: Array, states: Array, even: bool = False) -> Minimum | None:
        """Run a first pass with as many steps as the fastest mode needs at z, or more if the path diverges.

        `states` (T, n) show where friction reverses. With `even` the first try gives every sample the same few steps.
        Returns None if no number of steps gives a finite cost.
        """
        first = self.options.substeps or self._stable(z)
        for substeps in (first,) if self.options.substeps else (first, 4 * first, 16 * first):
            if even and substeps == first:
                start = self.cost.at(z, levels, np.full(len(self.data.time), min(first, STRONG_SUBSTEPS)), first)
            else:
                start = self.at(z, levels, states, substeps)
            if start is not None:
                return start
        return None

    def _stable(self, z: Array) -> int:
        if self.options.cell == "implicit":
            return 1
        return stable_substeps(self.data, self.kernel, self.cost.values(z), self.rough_states, sliding=True)

    def parameters(self, start: Minimum | None) -> Minimum | None:
        """Fit the parameters alone, with a loose tolerance."""
        return self._minimised(start, 1.0)

    def parameters_and_noise(self, start: Minimum | None, tolerance: float | None = None) -> Minimum | None:
        """Fit parameters and noise levels."""
        if start is not None:
            self.tell(f"fitting parameters and noise levels, {start.substeps} steps a sample")
        return self._minimised(start, self.tolerance if tolerance is None else tolerance, self.scoring)

    def _minimised(self, start: Minimum | None, tolerance: float, noise: NoiseScoring | None = None) -> Minimum | None:
        """Fit from `start`; return None without one, or where rounding hides what the data say."""
        found = minimise(self.cost, start, tolerance, self.options.max_iterations, noise)
        if found is None:
            return None
        self.effort.iterations += found.iterations
        self.effort.work += (steps := found.iterations * int(found.last.steps.sum()))
        self.effort.spent += steps
        return found if found.definite else None

    def again(self, found: Minimum, substeps: int, tolerance: float | None = None) -> Minimum | None:
        """Fit again from the end of another fit, with other steps or another start state."""
        start = self.at(found.z, found.levels, found.last.states, substeps)
        return self.parameters_and_noise(start, tolerance)

    def most_likely(self, found: Minimum) -> Minimum:
        """Return the point of maximum likelihood near `found` if its iteration stalled, else `found`.

        All searches of a fit together take at most as much work as its other iterations. So a fit with a wrong model
        stays almost as fast.
        """
        if found.distance_left < STALLED:
            return found
        self.tell("the iteration stalled: searching the largest likelihood")
        effort, each = self.effort, passes_each(found) * int(found.last.steps.sum())
        best = most_likely(self.cost, self.noise, found, (effort.work - effort.searched) // each)
        effort.searched += (steps := (best.iterations - found.iterations) * each)
        effort.spent += steps
        effort.iterations += best.iterations - found.iterations
        return best

    def given_up(self, best: Minimum) -> bool:
        """Return whether the search ends: it took long, and the best minimum so far does not describe the motion."""
        if self.effort.spent <= MOST_WORK * len(self.data.time):
            return False
        return bool(explained(self.data, best.last.residuals).reasons)

    def refined(self, found: Minimum, tolerance: float | None = None) -> Minimum:
        """Increase the steps per sample until twice as many move no estimate by 0.1 sigma, or 0.01 % if that is more.

        The change is computed from the gradient of one pass with twice as many steps. The estimate takes this change,
        and `Minimum.integration` keeps it as the remaining integration error. Where the integration error passes for
        noise, the estimates move less than it should make them, but the cost falls: that must not be either.
        """
        tolerance = self.tolerance if tolerance is None else tolerance
        while not self.options.substeps and not self.given_up(found):
            steps, substeps = found.last.steps, found.substeps
            # near the limit of stability a path may be finite with some steps and diverge with twice as many
            passes = (self.cost.at(found.z, found.levels, k * steps, substeps) for k in (2, 4, 8))
            finer = next((p for p in passes if p is not None and p.definite), None)
            if finer is None:
                return found
            covariance = finer.covariance
            step = shift = covariance @ finer.gradient
            moves, fall = self._excess(step, covariance) > 1.0, 0.0
            if moves or found.cost - finer.cost > FALLS:  # due to the integrator, or to an iteration that ended early
                here = self.cost.at(found.z, found.levels, steps, substeps)  # `found.last` is one step before
                if here is not None and found.cost - finer.cost > FALLS:
                    fall = here.cost - finer.cost
                if here is not None and moves:
                    shift = covariance @ (finer.gradient - here.gradient)
                    if tolerance > TOLERANCE and self._excess(step - shift, covariance) > 1.0:
                        tolerance = TOLERANCE
                        found = self.parameters_and_noise(here, tolerance) or found
                        continue
            excess = max(self._excess(shift, covariance), fall / FALLS)
            moved = shift if found.left.any() else step
            z = self.coordinates.clip(found.z + np.clip(moved, -1.0, 1.0))
            refined = replace(finer, z=z, settled=found.settled, integration=shift, left=found.left)
            if excess < 1.0 or 2 * substeps > MAX_SUBSTEPS:
                return refined
            # the error of a method of order four falls with the fourth power of the step
            more = substeps * int(np.clip(np.ceil(excess**0.25), 2, 4))
            again = self.again(refined, min(MAX_SUBSTEPS, more), tolerance)
            if again is None:
                return refined
            found = self.most_likely(again)
        return found

    def _excess(self, shift: Array, covariance: Array) -> float:
        """Return the largest ratio of a shift to the allowed integration error."""
        return float(
            np.max(np.abs(shift) / np.maximum(0.1 * np.sqrt(np.maximum(np.diag(covariance), 0.0)), self.least))
        )

    @property
    def least(self) -> Array:
        """Change of each coordinate that never justifies a finer step, shape (k,)."""
        return STEP_TOLERANCE * self.coordinates.unit
