"""The stages of a fit: from a start to the minimum of the innovations cost, with the steps that each sample needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum, minimise
from joint_id_core.estimators.innovations.likelihood_search import most_likely, passes_each
from joint_id_core.estimators.innovations.noise import NoiseLevels, NoiseScoring
from joint_id_core.estimators.innovations.options import MAX_SUBSTEPS, InnovationsOptions
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.shared.substeps import stable_substeps, steps_of

STRONG_SUBSTEPS = 2  # with strong feedback a rough step does
TOLERANCE = 0.1  # squared length of the last step in standard deviations
NEAR = 4.0  # the same beside an earlier estimate, or before a pass that will show what is left
FAR = 1.0  # standard deviations that an iteration may stall before its solution
STEP_TOLERANCE = 1e-4  # in z: what a finer step may still change where the data know better than that

Progress = Callable[[str], None]


class Stages:
    """Fits of one record, one after another.

    Attributes:
        substeps: RK4 steps a sample where nothing asks for more; steps (T,): those of each sample.
        iterations: of all stages.
        tolerance: squared length in standard deviations of the last step of a stage.
    """

    def __init__(
        self, cost: Cost, options: InnovationsOptions, noise: NoiseLevels, rough_states: Array, tell: Progress
    ) -> None:
        self.cost, self.options, self.noise, self.rough_states, self.tell = cost, options, noise, rough_states, tell
        self.recursion, self.coordinates = cost.recursion, cost.coordinates
        self.data, self.kernel = self.recursion.data, self.recursion.kernel
        self.scoring = NoiseScoring(self.recursion, noise)
        self.substeps = options.substeps
        self.steps: Steps = np.empty(0, dtype=np.int64)
        self.iterations = 0
        self.tolerance = TOLERANCE if options.substeps else NEAR
        self._work = self._searched = 0  # steps of the integrator, and those spent on the largest likelihood

    def of_part(self, first: int, length: int) -> Stages | None:
        """The same for a part of the record; None where it lacks a label."""
        part = self.data.part(first, first + length)
        if not np.isfinite(part.y).any(axis=0).all():
            return None
        cost = replace(self.cost, recursion=Recursion(part, self.kernel))
        return Stages(cost, self.options, self.noise, self.rough_states[first : first + length], self.tell)

    def at(self, z: Array, levels: Array) -> Minimum | None:
        """One pass with the present steps."""
        return self.cost.at(z, levels, self.steps)

    def take_steps(self, z: Array, states: Array, substeps: int) -> None:
        """From now on so many steps a sample, more where friction turns, as `states` (T, n) say."""
        self.substeps = substeps
        self.steps = steps_of(self.data, self.kernel, self.cost.values(z), states, substeps)

    def started(self, z: Array, levels: Array, states: Array, even: bool = False) -> Minimum | None:
        """A first pass with as many steps as the fastest mode needs at z, or more if the path blows up.

        `states` (T, n) tell where friction turns; with `even` every sample has the same steps, few of
        them, while that does.
        """
        first = self.options.substeps or self._stable(z)
        for substeps in (first,) if self.options.substeps else (first, 4 * first, 16 * first):
            if even and substeps == first:
                self.substeps = substeps
                self.steps = np.full(len(self.data.time), min(first, STRONG_SUBSTEPS))
            else:
                self.take_steps(z, states, substeps)
            start = self.at(z, levels)
            if start is not None:
                return start
        return None

    def _stable(self, z: Array) -> int:
        if self.options.cell == "implicit":
            return 1
        return stable_substeps(self.data, self.kernel, self.cost.values(z), self.rough_states, sliding=True)

    def parameters(self, start: Minimum | None) -> Minimum | None:
        """Fit the parameters alone, roughly."""
        return self._minimised(start, 1.0)

    def parameters_and_noise(self, start: Minimum | None) -> Minimum | None:
        """Fit parameters and noise levels."""
        self.tell(f"fitting parameters and noise levels, {self.substeps} steps a sample")
        return self._minimised(start, self.tolerance, self.scoring)

    def _minimised(self, start: Minimum | None, tolerance: float, noise: NoiseScoring | None = None) -> Minimum | None:
        found = minimise(self.cost, start, tolerance, self.options.max_iterations, noise)
        if found is not None:
            self.iterations += found.iterations
            self._work += found.iterations * int(self.steps.sum())
        return found

    def again(self, found: Minimum, substeps: int) -> Minimum | None:
        """Fit from where another fit ended, with other steps or another start of the record."""
        self.take_steps(found.z, found.last.states, substeps)
        return self.parameters_and_noise(self.at(found.z, found.levels))

    def most_likely(self, found: Minimum) -> Minimum:
        """Where the iteration stalled far from its solution, the point of largest likelihood near it.

        All searches of a fit together take no more work than what it did besides, so that it stays as fast, almost,
        where the model is wrong.
        """
        if found.distance_left < FAR:
            return found
        self.tell("the iteration stalled: searching the largest likelihood")
        each = passes_each(found) * int(found.last.steps.sum())
        best = most_likely(self.cost, self.noise, found, (self._work - self._searched) // each)
        self._searched += (best.iterations - found.iterations) * each
        self.iterations += best.iterations - found.iterations
        return best

    def refined(self, found: Minimum) -> Minimum:
        """More steps a sample until twice as many move no estimate by 0.1 sigma, or by 0.01 % where sigma is less.

        What they would do is seen from the gradient of one pass with twice as many steps. Its step is then taken, and
        stands for the error that is left.
        """
        while not self.options.substeps:
            # near the limit of stability the path may stand some steps a sample and not twice as many
            passes = (self.cost.at(found.z, found.levels, k * self.steps) for k in (2, 4, 8))
            finer = next((p for p in passes if p is not None), None)
            if finer is None:
                return found
            covariance = finer.covariance
            step = shift = covariance @ finer.gradient
            if self._excess(step, covariance) > 1.0:  # the integrator, or an iteration that ended early
                here = self.at(found.z, found.levels)
                shift = step if here is None else covariance @ (finer.gradient - here.gradient)
                if here is not None and self.tolerance > TOLERANCE and self._excess(step - shift, covariance) > 1.0:
                    self.tolerance = TOLERANCE
                    found = self.parameters_and_noise(here) or found
                    continue
            excess = self._excess(shift, covariance)
            moved = shift if found.left.any() else step
            z = self.coordinates.clip(found.z + np.clip(moved, -1.0, 1.0))
            refined = replace(finer, z=z, settled=found.settled, integration=shift, left=found.left)
            if excess < 1.0 or 2 * self.substeps > MAX_SUBSTEPS:
                return refined
            # the error of a method of order four falls with the fourth power of the step
            more = self.substeps * int(np.clip(np.ceil(excess**0.25), 2, 4))
            again = self.again(refined, min(MAX_SUBSTEPS, more))
            if again is None:
                return refined
            found = self.most_likely(again)
        return found

    def _excess(self, shift: Array, covariance: Array) -> float:
        """Largest shift over what is allowed of an integration error."""
        return float(np.max(np.abs(shift) / np.maximum(0.1 * np.sqrt(np.diag(covariance)), self.least)))

    @property
    def least(self) -> Array:
        """Change of each coordinate that is never worth a finer step."""
        return STEP_TOLERANCE * self.coordinates.unit
