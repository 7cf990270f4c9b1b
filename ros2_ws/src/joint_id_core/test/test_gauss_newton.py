"""The iteration on costs in one variable, whose solution is known."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.gauss_newton import MAX_STEP, evaluate, minimise
from joint_id_core.estimators.recursion import Pass
from joint_id_core.models import build

MODEL = build("rigid_joint")
FREE = ("tau_0",)  # any sign, so that its coordinate is its value
INFORMATION = 100.0


class Line:
    """Passes whose estimating equation is solved at `solution`, and whose cost is least at `lowest`."""

    def __init__(self, solution: float, lowest: float) -> None:
        self.solution, self.lowest = solution, lowest

    def run(self, free, levels, steps):
        z = float(free[0])
        error = np.full((1, 1), z)
        cost = INFORMATION * (z - self.lowest) ** 2
        hessian, gradient = np.full((1, 1), INFORMATION), np.array([INFORMATION * (self.solution - z)])
        return Pass(cost, error, np.ones((1, 1)), hessian, gradient, np.zeros((1, 1)), free, levels, steps)


def solved(line: Line):
    coordinates = Coordinates(MODEL, FREE)
    belief = Belief(FREE, np.zeros(1), np.full((1, 1), 1e-12))
    steps = np.ones(1, dtype=np.int64)
    start = evaluate(line, coordinates, belief, np.array([0.2]), np.ones(1), steps)
    return minimise(line, coordinates, belief, start, steps, 0.01, 100)


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
    line = Line(np.nan, np.nan)
    coordinates = Coordinates(MODEL, FREE)
    belief = Belief(FREE, np.zeros(1), np.eye(1))
    assert evaluate(line, coordinates, belief, np.zeros(1), np.ones(1), np.ones(1, dtype=np.int64)) is None
    assert minimise(line, coordinates, belief, None, np.ones(1, dtype=np.int64), 0.01, 5) is None
