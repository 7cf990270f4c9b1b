"""The iteration, and the search for the largest likelihood, on costs in one variable, whose solution is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.cell.kernel import compile_model
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.gauss_newton import MAX_STEP, Cost, minimise
from joint_id_core.estimators.innovations.likelihood_search import REACH, most_likely, passes_each
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.recursion import NoiseInformation, Pass
from joint_id_core.models import build

MODEL = build("rigid_joint")
FREE = ("tau_0",)  # any sign, so that its coordinate is its value
INFORMATION = 100.0


class Line:
    """Passes whose estimating equation is solved at `solution`, and whose cost is least at `lowest`.

    By the logarithm of its one noise level it is least at `quiet`. Beyond `cliff` the path blows up. With `rough` the
    cost has waves of this height, far shorter than a difference.
    """

    kernel = compile_model(MODEL)  # for the algebra of the iteration

    def __init__(self, solution: float, lowest: float, quiet: float = 0.0, cliff: float = np.inf) -> None:
        self.solution, self.lowest, self.quiet, self.cliff = solution, lowest, quiet, cliff
        self.rough = 0.0
        self.passes = 0

    def renewed(self, last):
        return last

    def noise_information(self, last):
        return NoiseInformation(np.zeros(1), np.full((1, 1), INFORMATION), np.zeros((1, 1)))

    def run(self, free, levels, steps):
        self.passes += 1
        z = float(free[0])
        error = np.full((1, 1), z)
        cost = INFORMATION * ((z - self.lowest) ** 2 + float(np.log(levels[0]) - self.quiet) ** 2)
        cost += self.rough * np.sin(1e9 * z)
        cost = np.inf if z > self.cliff else cost
        hessian, gradient = np.full((1, 1), INFORMATION), np.array([INFORMATION * (self.solution - z)])
        return Pass(cost, error, np.ones((1, 1)), hessian, gradient, np.zeros((1, 1)), free, levels, steps)


COORDINATES = Coordinates(MODEL, FREE)
BELIEF = Belief(FREE, np.zeros(1), np.full((1, 1), 1e-12))


def solved(line: Line):
    cost, steps = Cost(line, COORDINATES, BELIEF), np.ones(1, dtype=np.int64)
    return minimise(cost, cost.at(np.array([0.2]), np.ones(1), steps, 1), 0.01, 100)


def test_where_cost_and_equation_agree_it_ends_there():
    found = solved(Line(0.7, 0.7))
    assert found.z[0] == pytest.approx(0.7, abs=0.011)  # a tenth of a standard deviation
    assert found.iterations <= 3 and not found.left.any()
    assert found.covariance[0, 0] == pytest.approx(1.0 / INFORMATION)


def test_where_they_do_not_it_stalls_and_counts_the_distance():
    """The likelihood of a wrong model: no step towards the solution of the equation lowers it."""
    found = solved(Line(0.9, -0.5))
    assert found.z[0] == pytest.approx(0.2, abs=0.05)
    assert found.left[0] == pytest.approx(min(0.9 - found.z[0], MAX_STEP), rel=1e-6)
    assert found.covariance[0, 0] == pytest.approx(1.0 / INFORMATION + found.left[0] ** 2)


def test_a_cost_that_is_not_finite_gives_no_pass():
    cost = Cost(Line(np.nan, np.nan), COORDINATES, BELIEF)
    assert cost.at(np.zeros(1), np.ones(1), np.ones(1, dtype=np.int64), 1) is None
    assert minimise(cost, None, 0.01, 5) is None


def likeliest(line: Line, largest_noise: float = 1e6, iterations: int = 100):
    """From where the iteration stalls to the largest likelihood."""
    found = solved(line)
    assert found.left.any()
    bounds = NoiseLevels(None, np.full(1, 1e-6), np.full(1, largest_noise))
    return most_likely(Cost(line, COORDINATES, BELIEF), bounds, found, iterations)


def test_the_largest_likelihood_is_found_for_coordinates_and_noise_whatever_the_equation_says():
    found = likeliest(Line(0.45, -0.5, quiet=0.7))
    assert found.z[0] == pytest.approx(-0.5, abs=0.01)  # a tenth of a standard deviation
    assert np.log(found.levels[0]) == pytest.approx(0.7, abs=0.01)
    assert found.settled
    assert found.left[0] == pytest.approx(0.45 - found.z[0])  # as far as the two are apart, the estimate is uncertain
    assert found.distance_left == pytest.approx(9.5, abs=0.1)


def test_noise_levels_stay_within_their_bounds():
    found = likeliest(Line(0.9, -0.5, quiet=0.7), largest_noise=1.5)
    assert found.levels[0] == pytest.approx(1.5)
    assert found.z[0] == pytest.approx(-0.5, abs=0.01)


@pytest.mark.parametrize(("z", "level"), [(0.2, 2.0), (0.2, 1.5 * (1.0 + 1e-12)), (2e4, 1.0), (-2e4, 1e-9)])
def test_a_start_outside_of_the_bounds_is_moved_to_them(z, level):
    """A level that was found on its bound may be beyond it by rounding."""
    cost, steps = Cost(Line(0.9, -0.5), COORDINATES, BELIEF), np.ones(1, dtype=np.int64)
    outside = minimise(cost, cost.at(np.array([z]), np.array([level]), steps, 1), 0.01, 0)
    assert outside.z[0] == z and outside.levels[0] == level
    found = most_likely(cost, NoiseLevels(None, np.full(1, 1e-6), np.full(1, 1.5)), outside, 100)
    assert np.isfinite(found.cost) and found.cost <= outside.cost
    assert abs(found.z[0]) <= 1e4 and 1e-6 * (1 - 1e-9) <= found.levels[0] <= 1.5 * (1 + 1e-9)


def test_the_search_stays_within_its_reach():
    far = -10.0 * REACH * COORDINATES.unit[0]
    found = likeliest(Line(0.9, far))
    assert found.z[0] == pytest.approx(solved(Line(0.9, far)).z[0] - REACH * COORDINATES.unit[0])


def test_a_path_that_blows_up_on_the_way_is_not_taken():
    """The cost is least beyond the cliff; what is found is the best of what there is."""
    line = Line(-0.9, 0.5, cliff=0.3)
    found = likeliest(line)
    assert np.isfinite(found.cost) and found.cost <= solved(line).cost
    assert found.z[0] <= 0.3


def searched(rough: float):
    """Where the iteration stalls on a smooth cost, that point on one with waves, and what the search finds there."""
    line = Line(0.9, -0.5)
    cost, stalled = Cost(line, COORDINATES, BELIEF), solved(line)
    line.rough = rough
    start = replace(cost.at(stalled.z, stalled.levels, stalled.last.steps, 1), left=stalled.left)
    line.passes = 0
    return line, start, most_likely(cost, NoiseLevels(None, np.full(1, 1e-6), np.full(1, 1e6)), start, 100)


def test_a_cost_without_slopes_is_not_searched():
    """A filter that leaves its labels and comes back answers to the last digits of its parameters."""
    line, start, found = searched(rough=50.0)
    assert line.passes <= 5
    assert found.cost <= start.cost and found.z[0] == pytest.approx(start.z[0], abs=2e-4)
    assert found.left[0] == pytest.approx(0.9 - found.z[0])
    assert found.iterations - start.iterations == 100 and not found.settled


def test_waves_that_hide_no_slope_do_no_harm():
    _, _, found = searched(rough=1e-5)
    assert found.z[0] == pytest.approx(-0.5, abs=0.01)  # a tenth of a standard deviation
    assert found.settled


def test_a_steep_cost_is_searched():
    """The largest likelihood is 10,000 standard deviations away, so that it changes by 10 over a difference."""
    far = -1e4 / INFORMATION**0.5
    found = likeliest(Line(0.9, far))
    assert found.z[0] == pytest.approx(max(far, solved(Line(0.9, far)).z[0] - REACH * COORDINATES.unit[0]), abs=0.01)


def test_the_search_takes_no_more_iterations_than_it_is_given():
    line = Line(0.9, -0.5, quiet=0.7)
    stalled = solved(line)
    assert likeliest(line, iterations=0).cost == stalled.cost
    before = line.passes
    found = likeliest(line, iterations=1)
    assert found.cost < stalled.cost and found.iterations == stalled.iterations + 1
    assert line.passes - before <= stalled.iterations + 2 + 2 * passes_each(found)
