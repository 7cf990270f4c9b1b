"""The way from a belief, or from an earlier estimate, to the minimum of the innovations cost: which starts it takes."""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.annealing import annealed
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.options import InnovationsOptions
from joint_id_core.estimators.innovations.recursion import LONGEST_GAP, Recursion
from joint_id_core.estimators.innovations.stages import TOLERANCE, Progress, Stages
from joint_id_core.estimators.innovations.verdicts import explained
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.results.estimate import Estimate

HEAD = 250  # samples after which the start of a record is forgotten
SAME_STEPS = 0.02  # shift of an estimate, in spreads of its prior, that leaves the steps as they are (5 % mostly)
SAME_LEVELS = 0.15  # change of a noise level's logarithm that leaves the covariance as it is (8 % of a sigma at most)
SAME_COST = 2.0  # two starts that end this near to each other in cost have found the same minimum
EXTRA_STARTS = 6  # when states are not measured, the cost has several minima


class Search:
    """The search for one minimum.

    Attributes:
        stages: those of its fits.
        doubt: why the minimum cannot be trusted; empty where nothing speaks against it.
        alone: what to say of a minimum that only one start reached; empty where two did.
    """

    def __init__(
        self, data: FitData, kernel: Kernel, options: InnovationsOptions, belief: Belief | None, tell: Progress
    ) -> None:
        """A search from `belief`, or without one from the start values."""
        coordinates = Coordinates(data.model, data.free, options.known(data.model, data.free))
        self.belief = belief or Belief.before_data(data, coordinates)
        cost = Cost(Recursion(data, kernel), coordinates, self.belief)
        self.stages = Stages(cost, options, NoiseLevels.of(data), rough_states(data), tell)
        self.doubt = self.alone = ""

    def warm(self, previous: Estimate) -> Minimum | None:
        """Start from a previous estimate of the same quantities; None if it is of others or leads nowhere."""
        stages = self.stages
        levels = np.square(np.array(list(previous.noise.values())))
        if previous.free != stages.data.free or len(levels) != len(stages.noise.lower):
            return None
        coordinates, values = stages.coordinates, previous.values
        z = coordinates.clip(coordinates.z(np.array([values[n] for n in previous.free])))
        levels = stages.noise.clip(levels)
        stages.take_steps(z, stages.rough_states, stages.options.substeps or previous.substeps)
        self._choose_start(z, levels)
        found = stages.parameters_and_noise(stages.at(z, levels))
        if found is not None and stages.scoring.change(found.last.levels, found.levels) > SAME_LEVELS:
            found = stages.parameters_and_noise(stages.at(found.z, found.levels))
        if found is None:
            return None
        found = stages.most_likely(found)
        if float(np.max(np.abs(found.z - z) / coordinates.spread)) < SAME_STEPS:
            return found  # the step size was judged for these values
        return stages.refined(found)

    def cold(self) -> Minimum | None:
        """Start from the belief; from others too until one describes the data, or two with unmeasured states."""
        stages, data = self.stages, self.stages.data
        stages.recursion.start_near(None)  # a warm start may have failed before
        measured = len(data.labels) == len(data.model.states)  # one minimum, as a rule
        if not measured:
            stages.tolerance = TOLERANCE  # the costs of several minima are compared
        ends: list[tuple[Minimum, int, Steps]] = []
        agreed = False
        rng = np.random.default_rng(0)
        for k in range(1 + EXTRA_STARTS):
            z = self.belief.mean
            if k:
                stages.tell(f"start {k + 1} of {1 + EXTRA_STARTS}")
                z = stages.coordinates.clip(z + 0.5 * stages.coordinates.spread * rng.uniform(-1.0, 1.0, len(z)))
            end = annealed(stages, z, whole=k > 0)
            if end is None:
                continue
            ends.append((end, stages.substeps, stages.steps))
            best, agreed = _lowest(ends)
            agreed = agreed or measured
            if agreed and not explained(data, best.last.residuals).reasons:
                break
        if not ends:
            return None
        ends.sort(key=lambda item: item[0].cost)
        for k, (end, substeps, steps) in enumerate(ends):
            ends[k] = stages.most_likely(end), substeps, steps
            agreed = agreed or _lowest(ends)[1]
            if agreed:
                break
        best, stages.substeps, stages.steps = min(ends, key=lambda item: item[0].cost)
        starts = f"of {1 + EXTRA_STARTS} starts"
        if len(ends) == 1 and not agreed:
            self.doubt = f"only one {starts} led to a minimum, the others nowhere, so a better one may exist"
        elif not agreed:
            self.alone = f"only one {starts} led to this minimum, the lowest of {len(ends)}: a lower one may exist"
        if self._choose_start(best.z, best.levels):
            loaded = stages.again(best, stages.substeps)
            if loaded is None:
                stages.recursion.start_near(None)
            best = loaded or best
        return stages.refined(best)

    def _choose_start(self, z: Array, levels: Array) -> bool:
        """Start the record from the twist under its first load if that is likelier; whether it is.

        For a motor position that is not measured. So it is in a window that begins in motion, and is not in one that
        begins with a jump of the drive.
        """
        stages, data = self.stages, self.stages.data
        if "motor_position" not in set(data.model.state_names) - set(data.labels):
            return False
        p, count = stages.cost.values(z), len(data.time)
        if not np.any(data.gap > LONGEST_GAP):
            count = min(count, HEAD)
        head = Cost(Recursion(data.part(0, count), stages.kernel), stages.coordinates, self.belief)
        costs = []
        for near in (None, p):
            head.recursion.start_near(near)
            found = head.at(z, levels, stages.steps[:count])
            costs.append(np.inf if found is None else found.cost)
        relaxed, loaded = costs
        stages.recursion.start_near(p if loaded < relaxed else None)
        return loaded < relaxed


def _lowest(ends: list[tuple[Minimum, int, Steps]]) -> tuple[Minimum, bool]:
    """The lowest of the minima that starts led to, and whether another one is the same."""
    best = min((end for end, _, _ in ends), key=lambda end: end.cost)
    return best, sum(_same(best, other) for other, _, _ in ends) > 1


def _same(one: Minimum, other: Minimum) -> bool:
    """Whether two starts led to the same minimum: by its cost, or within a sigma where an iteration stalled."""
    sigma = np.sqrt(np.diag(one.covariance + other.covariance))
    return abs(one.cost - other.cost) < SAME_COST or bool(np.all(np.abs(one.z - other.z) < sigma))
