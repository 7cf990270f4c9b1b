"""Parameters that are hardly known, beside others that do the same to the motion."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from joint_id_core.estimators.innovations.vanishing import of_vanishing
from joint_id_core.models import build

NAMES = ("c_m", "c_q", "J_q")
SPREAD = 2.3  # of the logarithms, before the data
NOISE = 0.01  # of the sum of the first two, which is all that the data tell of them, and of the third


def minimum(small: float, names: tuple[str, ...] = NAMES, stiffer: float = 1.0) -> tuple[Any, Any]:
    """A fit of three parameters of which the first is so small, the others 1.

    It ended at its start, but for the second, which is so many times larger.
    """
    values = np.array([small, 1.0, 1.0])
    told = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) * values / NOISE  # by the logarithms
    prior = np.eye(3) / SPREAD**2
    hessian = told.T @ told + prior
    belief = SimpleNamespace(mean=np.log(values / [1.0, stiffer, 1.0]), precision=prior)
    data = SimpleNamespace(data=SimpleNamespace(free=names, model=build("harmonic_drive")))
    cost = SimpleNamespace(coordinates=SimpleNamespace(positive=np.ones(3, bool)), belief=belief, recursion=data)
    return cost, SimpleNamespace(z=np.log(values), hessian=hessian, inverse=np.linalg.inv(hessian))


@pytest.mark.parametrize("small", [1e-6, 1e-4, 1e-3])
def test_one_of_a_sum_is_known_as_far_as_the_other_may_be_larger(small):
    cost, found = minimum(small)
    assert np.sqrt(found.inverse[1, 1]) == pytest.approx(NOISE, rel=0.05), "what is at stake"
    most = small * np.exp(2.0 * SPREAD)  # that the prior believes
    covariance = found.inverse + of_vanishing(cost, found)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(np.hypot(NOISE, most), rel=0.05)
    assert covariance[2, 2] == pytest.approx(found.inverse[2, 2]), "it does something else"
    assert covariance[0, 0] == found.inverse[0, 0]


def test_the_cubic_stiffness_may_be_larger_by_the_third_power_of_what_the_gear_is_stiffer():
    """It twists less then, under the same torque, so that k_2 of a common gear is larger and k_1 less known."""
    covariances = [
        np.sqrt((found.inverse + of_vanishing(cost, found))[1, 1])
        for cost, found in (minimum(1e-6, ("k_2", "k_1", "J_q"), stiffer) for stiffer in (0.1, 1.0, 10.0))
    ]
    most = 1e-6 * np.exp(2.0 * SPREAD) * np.array([1.0, 1.0, 1e3])
    assert covariances == pytest.approx(np.hypot(NOISE, most).tolist(), rel=0.05)


def test_what_is_known_or_told_in_combination_stays():
    cost, found = minimum(1e-3)
    assert not of_vanishing(cost, found, apart={"c_m"}).any()
    cost, found = minimum(1.0)
    known = SimpleNamespace(z=found.z, hessian=found.hessian + 10.0 * np.eye(3), inverse=np.eye(3) / 10.0)
    assert not of_vanishing(cost, known).any()
