"""The way from a belief, or from an earlier estimate, to the minimum of the innovations cost: starts and step sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from joint_id_core.codegen import Kernel
from joint_id_core.estimate import Estimate
from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.gauss_newton import Minimum, evaluate, minimise
from joint_id_core.estimators.innovations_options import MAX_SUBSTEPS, InnovationsOptions
from joint_id_core.estimators.most_likely import most_likely
from joint_id_core.estimators.noise import NoiseLevels, NoiseScoring
from joint_id_core.estimators.recursion import LONGEST_GAP, Recursion
from joint_id_core.estimators.start import busiest, rough_states
from joint_id_core.estimators.substeps import stable_substeps, steps_of
from joint_id_core.identifiability import explained
from joint_id_core.problem import Problem
from joint_id_core.recording import Array
from joint_id_core.rk4 import Steps

STRONGEST, STRONG = 1e6, 1e4  # first input noise over its rough level: the feedback of the previous labels
FEEDBACK = (STRONGEST, STRONG, 1.0)  # tried in turn: a stiff joint may not stand the strongest
STRONG_SUBSTEPS = 2  # with that feedback a rough step does
TOLERANCE = 0.1  # squared length of the last step in standard deviations
NEAR = 4.0  # the same beside an earlier estimate, or before a pass that will show what is left
EXCERPT, SHORTEST = 4, 250  # length of a record over that of its excerpt, and the shortest excerpt in samples
STEP_TOLERANCE = 1e-4  # in z: what a finer step may still change where the data know better than that
SAME_STEPS = 0.02  # shift of an estimate, in spreads of its prior, that leaves the steps as they are (5 % mostly)
SAME_LEVELS = 0.15  # change of a noise level's logarithm that leaves the covariance as it is (8 % of a sigma at most)
FAR = 1.0  # standard deviations that an iteration may stall before its solution
SAME_COST = 2.0  # two starts that end this near to each other in cost have found the same minimum
EXTRA_STARTS = 6  # when states are not measured, the cost has several minima

Progress = Callable[[str], None]


class Search:
    """The stages of one fit on one problem.

    Attributes:
        substeps: RK4 steps a sample where nothing asks for more; steps (T,): those of each sample.
        iterations: of all stages.
        doubt: why the minimum cannot be trusted; empty where nothing speaks against it.
        alone: what to say of a minimum that only one start reached; empty where two did.
        tolerance: squared length in standard deviations of the last step of a stage.
    """

    def __init__(
        self,
        problem: Problem,
        kernel: Kernel,
        options: InnovationsOptions,
        coordinates: Coordinates,
        belief: Belief,
        noise: NoiseLevels,
        rough: Array,
        tell: Progress,
    ) -> None:
        self.problem, self.kernel, self.options, self.tell = problem, kernel, options, tell
        self.coordinates, self.belief, self.noise, self.rough_states = coordinates, belief, noise, rough
        self.recursion = Recursion(problem, kernel)
        self.scoring = NoiseScoring(self.recursion, noise)
        self.substeps = options.substeps
        self.steps: Steps = np.empty(0, dtype=np.int64)
        self.iterations = 0
        self.doubt = self.alone = ""
        self._searched = 0  # work spent on the largest likelihood
        self.tolerance = TOLERANCE if options.substeps else NEAR

    @classmethod
    def of(
        cls, problem: Problem, kernel: Kernel, options: InnovationsOptions, belief: Belief | None, tell: Progress
    ) -> Search:
        """A search from `belief`, or without one from the start values."""
        coordinates = Coordinates(problem.model, problem.free, options.known(problem.model, problem.free))
        belief = belief or Belief.before_data(problem, coordinates)
        return cls(problem, kernel, options, coordinates, belief, NoiseLevels.of(problem), rough_states(problem), tell)

    def warm(self, previous: Estimate) -> Minimum | None:
        """Start from a previous estimate of the same quantities; None if it is of others or leads nowhere."""
        levels = np.square(np.array(list(previous.noise.values())))
        if previous.free != self.problem.free or len(levels) != len(self.noise.lower):
            return None
        self.substeps = self.options.substeps or previous.substeps
        values = previous.values
        z = self.coordinates.clip(self.coordinates.z(np.array([values[n] for n in previous.free])))
        levels = self.noise.clip(levels)
        self.steps = steps_of(self.problem, self.kernel, self._values(z), self.rough_states, self.substeps)
        self._choose_start(z, levels)
        found = self._continued(self._at(z, levels, self.steps))
        if found is not None and self.scoring.change(found.last.levels, found.levels) > SAME_LEVELS:
            found = self._continued(self._at(found.z, found.levels, self.steps))
        if found is None:
            return None
        found = self._most_likely(found)
        if float(np.max(np.abs(found.z - z) / self.coordinates.spread)) < SAME_STEPS:
            return found  # the step size was judged for these values
        return self._refined(found)

    def cold(self) -> Minimum | None:
        """Start from the belief; from others too until one describes the data, or two with unmeasured states."""
        self.recursion.start_near(None)  # a warm start may have failed before
        measured = len(self.problem.labels) == len(self.problem.model.states)  # one minimum, as a rule
        if not measured:
            self.tolerance = TOLERANCE  # the costs of several minima are compared
        found: list[tuple[Minimum, int, Steps]] = []
        best, agreed = None, False
        rng = np.random.default_rng(0)
        for k in range(1 + EXTRA_STARTS):
            z = self.belief.mean
            if k:
                self.tell(f"start {k + 1} of {1 + EXTRA_STARTS}")
                z = self.coordinates.clip(z + 0.5 * self.coordinates.spread * rng.uniform(-1.0, 1.0, len(z)))
            end = self._annealed(z, whole=k > 0)
            if end is None:
                continue
            found.append((end, self.substeps, self.steps))
            best = min((end for end, _, _ in found), key=lambda end: end.cost)
            agreed = measured or sum(_same(best, other) for other, _, _ in found) > 1
            if agreed and not explained(self.problem, best.last.residuals).reasons:
                break
        if best is None:
            return None
        found.sort(key=lambda item: item[0].cost)
        for k, (end, substeps, steps) in enumerate(found):
            found[k] = self._most_likely(end), substeps, steps
            best, self.substeps, self.steps = min(found, key=lambda item: item[0].cost)
            agreed = agreed or sum(_same(best, other) for other, _, _ in found) > 1
            if agreed:
                break
        starts = f"of {1 + EXTRA_STARTS} starts"
        if len(found) == 1 and not agreed:
            self.doubt = f"only one {starts} led to a minimum, the others nowhere, so a better one may exist"
        elif not agreed:
            self.alone = f"only one {starts} led to this minimum, the lowest of {len(found)}: a lower one may exist"
        if self._choose_start(best.z, best.levels):
            loaded = self._minimised(best.z, best.levels, best.last.states)
            if loaded is None:
                self.recursion.start_near(None)
            best = loaded or best
        return self._refined(best)

    def _annealed(self, z: Array, whole: bool = True) -> Minimum | None:
        """One fit from z with rough noise levels and the first step size: feedback from strong to optimal.

        Where every state is measured the noise levels, fitted along, weaken the feedback by themselves as fast as the
        parameters come closer; unmeasured states need parameters that are not far off before that. With `whole` false
        the first part of the way is gone on an excerpt of the record.
        """
        rough, states = self.noise.rough, self.rough_states
        inputs = np.arange(len(rough)) >= len(self.problem.labels)
        if len(self.problem.labels) < len(self.problem.model.states):
            tries = (self._started(z, np.where(inputs, by * rough, rough), states, even=True) for by in FEEDBACK)
            start = next((s for s in tries if s is not None), None)
            found = minimise(
                self.recursion, self.coordinates, self.belief, start, self.steps, 1.0, self.options.max_iterations
            )
            if found is None:
                return None
            self.iterations += found.iterations
            z, states = found.z, found.last.states
        elif not whole and (near := self._from_excerpt(z)) is not None:
            return self._continued(self._started(near.z, near.levels, states))
        start = self._started(z, self.noise.clip(np.where(inputs, STRONG * rough, rough)), states)
        return self._continued(start)

    def _from_excerpt(self, z: Array) -> Minimum | None:
        """A fit of the part of the record where most happens, itself begun on an excerpt; None where it is too short.

        Far from the solution a part of the record shows the way as well as all of it.
        """
        length = len(self.problem.time) // EXCERPT
        if length < SHORTEST:
            return None
        first = busiest(self.problem, length)
        part = self.problem.part(first, first + length)
        if not np.isfinite(part.y).any(axis=0).all():
            return None
        excerpt = Search(
            part, self.kernel, self.options, self.coordinates, self.belief, self.noise,
            self.rough_states[first : first + length], self.tell,
        )  # fmt: skip
        found = excerpt._annealed(z, whole=False)
        self.iterations += excerpt.iterations
        return found if found is not None and found.settled else None

    def _started(self, z: Array, levels: Array, states: Array, even: bool = False) -> Minimum | None:
        """A first pass with as many steps as the fastest mode needs at z, or more if the path blows up.

        `states` (T, n) tell where friction turns; with `even` every sample has the same steps, few of
        them, while that does.
        """
        first = self.options.substeps or self._stable(z)
        for substeps in (first,) if self.options.substeps else (first, 4 * first, 16 * first):
            self.substeps = substeps
            if even and substeps == first:
                self.steps = np.full(len(self.problem.time), min(first, STRONG_SUBSTEPS))
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
        count = len(self.problem.time)
        if count > SHORTEST and not np.any(self.problem.gap > LONGEST_GAP):  # its start is soon forgotten
            count = SHORTEST
        head = Recursion(self.problem.part(0, count), self.kernel)
        costs = []
        for near in (None, self._values(z)):
            head.start_near(near)
            found = evaluate(head, self.coordinates, self.belief, z, levels, self.steps[:count])
            costs.append(np.inf if found is None else found.cost)
        relaxed, loaded = costs
        self.recursion.start_near(self._values(z) if loaded < relaxed else None)
        return loaded < relaxed

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
            self.recursion, self.coordinates, self.belief, start, self.steps, self.tolerance,
            self.options.max_iterations, self.scoring,
        )  # fmt: skip
        self.iterations += found.iterations if found else 0
        return found

    def _most_likely(self, found: Minimum) -> Minimum:
        """Where the iteration stalled far from its solution, the point of largest likelihood near it.

        All searches of a fit together take no more work than what it did besides, so that it stays as fast, almost,
        where the model is wrong.
        """
        if found.distance_left < FAR:
            return found
        self.tell("the iteration stalled: searching the largest likelihood")
        before = self.recursion.work
        left = before - 2 * self._searched
        best = most_likely(self.recursion, self.coordinates, self.belief, self.noise, found, left)
        self._searched += self.recursion.work - before
        self.iterations += best.iterations - found.iterations
        return best

    def _refined(self, found: Minimum | None) -> Minimum | None:
        """More steps a sample until twice as many move no estimate by 0.1 sigma, or by 0.01 % where sigma is less.

        What they would do is seen from the gradient of one pass with twice as many steps. Its step is then taken, and
        stands for the error that is left.
        """
        while found is not None and not self.options.substeps:
            # near the limit of stability the path may stand some steps a sample and not twice as many
            passes = (self._at(found.z, found.levels, k * self.steps) for k in (2, 4, 8))
            finer = next((p for p in passes if p is not None), None)
            if finer is None:
                return found
            covariance = finer.covariance
            step = shift = covariance @ finer.gradient
            if self._excess(step, covariance) > 1.0:  # the integrator, or an iteration that ended early
                here = self._at(found.z, found.levels, self.steps)
                shift = step if here is None else covariance @ (finer.gradient - here.gradient)
                if here is not None and self.tolerance > TOLERANCE and self._excess(step - shift, covariance) > 1.0:
                    self.tolerance = TOLERANCE
                    found = self._continued(here)
                    continue
            excess = self._excess(shift, covariance)
            moved = shift if found.left.any() else step
            z = self.coordinates.clip(found.z + np.clip(moved, -1.0, 1.0))
            refined = replace(finer, z=z, settled=found.settled, integration=shift, left=found.left)
            if excess < 1.0 or 2 * self.substeps > MAX_SUBSTEPS:
                return refined
            # the error of a method of order four falls with the fourth power of the step
            self.substeps = min(MAX_SUBSTEPS, self.substeps * int(np.clip(np.ceil(excess**0.25), 2, 4)))
            found = self._minimised(z, found.levels, finer.last.states)
            if found is None:
                return refined
            found = self._most_likely(found)
        return found

    def _excess(self, shift: Array, covariance: Array) -> float:
        """Largest shift over what is allowed of an integration error."""
        return float(np.max(np.abs(shift) / np.maximum(0.1 * np.sqrt(np.diag(covariance)), self.least)))

    @property
    def least(self) -> Array:
        """Change of each coordinate that is never worth a finer step."""
        return STEP_TOLERANCE * self.coordinates.unit


def _same(one: Minimum, other: Minimum) -> bool:
    """Whether two starts led to the same minimum: by its cost, or within a sigma where an iteration stalled."""
    sigma = np.sqrt(np.diag(one.covariance + other.covariance))
    return abs(one.cost - other.cost) < SAME_COST or bool(np.all(np.abs(one.z - other.z) < sigma))
