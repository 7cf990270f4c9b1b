"""Search for the minimum of the innovations cost: from an earlier estimate, or from a prior with several starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.annealing import annealed, direct
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.innovations.stages import TOLERANCE, Stages
from joint_id_core.estimators.innovations.verdicts import explained
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate

HEAD = 250  # samples after which the start state of a record has no influence
SAME_STEPS = 0.02  # shift of an estimate, in spreads of its prior, up to which the step size is kept (mostly 5 %)
SAME_LEVELS = 0.15  # change of a noise level's logarithm up to which the covariance is kept (at most 8 % of a sigma)
SAME_COST = 2.0  # two starts whose costs differ by less have found the same minimum
CLOSE = 22.0  # difference of the costs of two minima up to which both are credible: 95 % of chi2 with 13 unknowns
FALSE = 0.1  # rise of the cost with enough integrator steps, over the number of samples, from which few made a minimum
MOST_FINISHED = 3  # minima that get enough steps, as far as those before were false: it takes time
APART = 2.0  # distance in standard deviations from which they are two
# When states are not measured, the cost has several minima. Feedback of the extra starts, that of labels from which the
# noise levels are fitted: from the prior mean, and from the best minimum so far. In ordinary motion each way finds the
# lowest minimum of some records where the others end elsewhere. The last start is at random, as are
# those without a minimum to start from.
FROM_PRIOR, FROM_BEST = (1e4, 1e2), (1e4, 1e2, 1.0)
EXTRA_STARTS = len(FROM_PRIOR) + len(FROM_BEST) + 1
UNSURE = 0.3  # standard deviation of a coordinate above which all starts are tried: there minima lie side by side


@dataclass(frozen=True)
class Outcome:
    """Result of a search.

    Attributes:
        stages: the stages of the fit, with the start state that suited the record.
        minimum: the best minimum that was found.
        doubt: why the minimum cannot be trusted; empty if there is no reason.
        alone: warning that only one start reached the minimum; empty if two did.
        others: minima that are nearly as likely, other than this one.
    """

    stages: Stages
    minimum: Minimum
    doubt: str = ""
    alone: str = ""
    others: tuple[Minimum, ...] = ()

    @property
    def scatter(self) -> Array:
        """Mean square distance of the others from the minimum, shape (k, k)."""
        squares = [np.outer(dz, dz) for dz in (other.z - self.minimum.z for other in self.others)]
        return np.asarray(sum(squares, np.zeros_like(self.minimum.hessian)) / max(1, len(squares)))

    @property
    def warning(self) -> str:
        """What the starts say against the minimum; empty if nothing."""
        if not self.others:
            return self.alone
        away = max(_distance(self.minimum, other) for other in self.others)
        return (
            f"starts led to minima that are as likely, up to {away:.2g} standard deviations apart, as they do where "
            "motion tells too little; the standard deviations contain that distance"
        )


@dataclass(frozen=True)
class _Finished:
    """A minimum with enough integrator steps.

    Attributes:
        stages, minimum: as in `Outcome`.
        end: of the start that led there.
        ends: of all starts, but for those of lower cost whose minima were false.
    """

    stages: Stages
    minimum: Minimum
    end: Minimum
    ends: list[Minimum]


class Search:
    """Search for one minimum, from an earlier estimate (`warm`) or from the prior (`cold`)."""

    def __init__(
        self, data: FitData, kernel: Kernel, options: Innovations, belief: Belief | None, tell: Progress
    ) -> None:
        """Prepare a search with the prior `belief`; None takes the start values and their spreads."""
        coordinates = Coordinates(data.model, data.free, data.priors)
        self._belief = belief or Belief.before_data(data, coordinates)
        cost = Cost(Recursion(data, kernel), coordinates, self._belief)
        self.stages = Stages(cost, options, NoiseLevels.of(data), rough_states(data), tell)

    def warm(self, previous: Estimate) -> Outcome | None:
        """Start from a previous estimate (warm start); return None if it does not fit the data or no pass is finite.

        The previous estimate must have the same free parameters and the same noise levels.
        """
        stages, names = self.stages, self.stages.data.noise_names
        if previous.free != stages.data.free or set(previous.noise) != set(names):
            return None
        coordinates, values = stages.coordinates, previous.values
        z = coordinates.clip(coordinates.z(np.array([values[n] for n in previous.free])))
        levels = stages.noise.clip(np.square([previous.noise[n] for n in names]))
        substeps = stages.options.substeps or previous.substeps
        states = stages.rough_states
        if self._starts_loaded(z, levels, stages.steps(z, states, substeps)):
            stages = stages.started_near(stages.cost.values(z))
        found = stages.parameters_and_noise(stages.at(z, levels, states, substeps))
        if found is not None and stages.scoring.change(found.last.levels, found.levels) > SAME_LEVELS:
            again = stages.cost.at(found.z, found.levels, found.last.steps, found.substeps)
            found = stages.parameters_and_noise(again)
        if found is None:
            return None
        found = stages.most_likely(found)
        if float(np.max(np.abs(found.z - z) / coordinates.spread)) < SAME_STEPS:
            return Outcome(stages, found)  # the step size was already checked for these values
        return Outcome(stages, stages.refined(found))

    def cold(self) -> Outcome | None:
        """Start from the prior mean and in other ways (`FROM_PRIOR`); return None if no start gives a finite cost.

        If all states are measured, it ends with the first fit that describes the data. With unmeasured states the best
        minimum must also have been reached from two starts, and the data must tell all parameters.
        """
        stages, data = self.stages, self.stages.data
        effort = stages.effort
        effort.work = effort.searched = effort.spent = 0  # that of a warm start which failed is no work of this search
        measured = len(data.labels) == len(data.model.states)  # usually one minimum
        tolerance = None if measured else TOLERANCE  # the costs of several minima are compared
        ends: list[Minimum] = []
        agreed, tried = False, 0
        while tried < 1 + EXTRA_STARTS and not (ends and stages.given_up(_lowest(ends)[0])):
            k, tried = tried, tried + 1
            end = self._end(k, _lowest(ends)[0].z if ends else None, measured, tolerance)
            if end is None:
                continue
            ends.append(end)
            best, agreed = _lowest(ends)
            agreed = agreed or measured
            sure = agreed and not explained(data, best.last.residuals).reasons and not _others(ends, best)
            if sure and (measured or np.max(np.sqrt(np.diag(best.covariance)) / stages.coordinates.unit) < UNSURE):
                break
        return self.concluded(ends, tried)

    def concluded(self, ends: list[Minimum], tried: int) -> Outcome | None:
        """Return what the ends of the starts tell together, with enough integrator steps; None if there are none.

        `tried` is the number of starts.
        """
        if not ends:
            return None
        stages, data = self.stages, self.stages.data
        measured = len(data.labels) == len(data.model.states)
        tolerance = None if measured else TOLERANCE
        agreed = measured or _lowest(ends)[1]
        ends.sort(key=lambda end: end.cost)
        for k, end in enumerate(ends):
            ends[k] = stages.most_likely(end)
            agreed = agreed or _lowest(ends)[1]
            if agreed or stages.given_up(_lowest(ends)[0]):
                break
        best = self._finished(ends, tolerance)
        if len(best.ends) < len(ends):
            agreed = measured or sum(_same(best.end, end) for end in best.ends) > 1
        doubt = alone = ""
        starts, others = f"of {tried} starts", _others(best.ends, best.end)
        if len(ends) == 1 and not agreed:
            doubt = f"only one {starts} led to a minimum, the others nowhere, so a better one may exist"
        elif not agreed:
            alone = f"only one {starts} led to this minimum, the lowest of {len(ends)}: a lower one may exist"
        return Outcome(best.stages, best.minimum, doubt, alone, others)

    def _finished(self, ends: list[Minimum], tolerance: float | None) -> _Finished:
        """Return the lowest minimum with enough integrator steps.

        Few steps may make a minimum where there is none, at a stiff joint for instance: those are left out of the ends.
        """
        found: list[_Finished] = []
        while ends and len(found) < MOST_FINISHED:
            best = min(ends, key=lambda end: end.cost)
            found.append(_Finished(*self._with_enough_steps(best, tolerance), best, ends))
            ends = [end for end in ends if end.cost > best.cost + SAME_COST]
            true = found[-1].minimum.cost < best.cost + FALSE * len(self.stages.data.time)
            if true or self.stages.given_up(found[-1].minimum):
                break
        return min(found, key=lambda one: one.minimum.cost)

    def _with_enough_steps(self, best: Minimum, tolerance: float | None) -> tuple[Stages, Minimum]:
        """Return a minimum with enough integrator steps, and its stages, which tell whether the gear starts loaded."""
        stages = self.stages
        if self._starts_loaded(best.z, best.levels, best.last.steps):
            near = stages.started_near(stages.cost.values(best.z))
            loaded = near.again(best, best.substeps, tolerance)
            if loaded is not None:
                stages, best = near, loaded
        return stages, stages.refined(best, tolerance)

    def _end(self, k: int, best: Array | None, measured: bool, tolerance: float | None) -> Minimum | None:
        """Return where start k ends, `best` (k,) being where the best one ended; None if it gives no finite cost."""
        stages, z, after = self.stages, self._belief.mean, k - 1 - len(FROM_PRIOR)
        if k:
            stages.tell(f"start {k + 1} of {1 + EXTRA_STARTS}")
        if 0 < k <= len(FROM_PRIOR):
            return direct(stages, z, FROM_PRIOR[k - 1], tolerance)
        if best is not None and 0 <= after < len(FROM_BEST):
            return direct(stages, best, FROM_BEST[after], tolerance)
        if k:
            off = np.random.default_rng(k).uniform(-1.0, 1.0, len(z))
            z = stages.coordinates.clip(z + 0.5 * stages.coordinates.spread * off)
        return annealed(stages, z, whole=measured and k > 0, tolerance=tolerance)

    def _starts_loaded(self, z: Array, levels: Array, steps: Steps) -> bool:
        """Choose the relaxed or the loaded start of the gear; return True if loaded.

        A loaded gear starts with the twist under its first load. The choice is needed if the motor position is not
        measured. A window that begins in motion starts loaded, one that begins with a jump of the drive starts relaxed.
        The likelihood of the first samples decides.
        """
        stages, data = self.stages, self.stages.data
        if "motor_position" not in set(data.model.state_names) - set(data.labels):
            return False
        p, count = stages.cost.values(z), len(data.time)
        if not len(data.starts):
            count = min(count, HEAD)
        part, costs = data.part(0, count), []
        for near in (None, p):
            head = Cost(Recursion(part, stages.kernel, near), stages.coordinates, self._belief)
            found = head.at(z, levels, steps[:count], 0)
            costs.append(np.inf if found is None else found.cost)
        relaxed, loaded = costs
        return loaded < relaxed


def _distance(best: Minimum, other: Minimum) -> float:
    """Return how far a minimum is from the best one in standard deviations of that one."""
    dz = other.z - best.z
    return float(np.sqrt(dz @ best.hessian @ dz))


def _others(ends: list[Minimum], best: Minimum) -> tuple[Minimum, ...]:
    """Return the minima that are nearly as likely as the best one, and elsewhere."""
    return tuple(end for end in ends if end.cost - best.cost < CLOSE and _distance(best, end) > APART)


def _lowest(ends: list[Minimum]) -> tuple[Minimum, bool]:
    """Return the minimum of lowest cost, and whether another start reached the same one."""
    best = min(ends, key=lambda end: end.cost)
    return best, sum(_same(best, other) for other in ends) > 1


def _same(one: Minimum, other: Minimum) -> bool:
    """Return whether two starts reached the same minimum: by cost, or within one sigma if an iteration stalled."""
    sigma = np.sqrt(np.maximum(np.diag(one.inverse + other.inverse), 0.0))  # rounding makes a flat valley negative
    return abs(one.cost - other.cost) < SAME_COST or bool(np.all(np.abs(one.z - other.z) < sigma))
