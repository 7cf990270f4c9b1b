"""Estimates over many draws hold the truth as often as they say, and generated kernels agree with C++ written by hand.

The motions and the C++ are those of the benchmarks.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from engine.kernel import AGREEMENT, CASES, Case, pair
from engine.yardstick import Yardstick
from montecarlo import online
from montecarlo.cases import CASES as NOISE
from montecarlo.draws import measure
from montecarlo.tables import summary

SEEDS = range(1000, 1006)
BY_NAME = {case.name: case for case in NOISE}


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("motions")


@pytest.fixture(scope="module")
def yardstick() -> Yardstick:
    return Yardstick()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_generated_kernels_agree_with_c_plus_plus(case: Case, yardstick: Yardstick):
    both = pair(case, yardstick)
    *_, X, J = both.arguments
    X[:], J[:] = np.nan, np.nan
    both.kernel.sensitivities.rollout_sensitivities(*both.arguments)
    both.cpp()
    assert both.difference() < AGREEMENT
    assert np.ptp(X, axis=0).min() > 0.0
    assert np.abs(J).max(axis=(0, 1)).min() > 0.0  # every parameter has moved something
    both.cpp.J[-1, -1, -1] *= 1.0 + 1e-8
    assert both.difference() > AGREEMENT


def test_six_draws_of_the_table_with_all_states(cache):
    """Nine parameters in six draws; limits at three standard deviations of what honest intervals do."""
    case = BY_NAME["Model 2, all four states, 0.02 Nm"]
    draws = measure(case, SEEDS, cache, 1)
    found = summary(draws)
    assert (found.converged, found.far, found.coloured) == (6, 0, 0)
    assert np.mean(found.coverage) >= 0.85
    assert 0.6 < np.sqrt(np.mean(found.ratio**2)) < 1.5
    assert np.max(found.sigma[[found.names.index(n) for n in ("J_m", "k_1", "k_2", "J_q")]]) < 0.03


@pytest.mark.long
def test_six_draws_of_two_labels_find_the_same_truth(cache):
    found = summary(measure(BY_NAME["Model 2, link position, motor velocity, 0.003 Nm"], SEEDS, cache, 1))
    assert (found.converged, found.far) == (6, 0)
    assert np.mean(found.coverage) >= 0.8


def test_strongly_coloured_torque_is_noticed(cache):
    found = summary(measure(BY_NAME["coloured torque, 0.02 Nm"], SEEDS[:2], cache, 1))
    assert (found.converged, found.coloured) == (0, 2)


@pytest.mark.parametrize(
    "name", ["coloured torque, 0.003 Nm", pytest.param("torque ripple of 0.005 Nm", marks=pytest.mark.long)]
)
def test_faint_colour_is_said_beside_the_estimate(name, cache):
    found = summary(measure(BY_NAME[name], SEEDS[:3], cache, 1))
    assert (found.converged, found.coloured) == (3, 3)


@pytest.mark.long
def test_a_friction_law_that_is_a_little_wrong_is_noticed(cache):
    found = summary(measure(BY_NAME["Stribeck friction, 10%"], SEEDS, cache, 1))
    right = summary(measure(BY_NAME["Model 2, all four states, 0.003 Nm"], SEEDS, cache, 1))
    assert found.misfit > right.misfit


@pytest.mark.long
def test_estimates_of_a_sliding_window_hold_the_truth(cache):
    """Four motions, 31 estimates each: 0.93 of the intervals in the long run, 0.05 is the scatter between motions."""
    found = online.measure(range(1000, 1004), cache, workers=1)
    for name, draws in found.items():
        assert all(draw.converged and not draw.far for draw in draws), name
        assert np.mean(summary(draws).coverage) > 0.80, name
    assert len(found["all four states"]) > 100
