"""Profiles of the likelihood of a memory, on valleys whose shape is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from joint_id_core.online.checks import at_once
from joint_id_core.online.likelihood_profile import profiled
from joint_id_core.online.memory import Memory
from joint_id_core.online.piece import Piece, Samples, State
from joint_id_core.online.profile_search import ProfileSearch

MEMORY_S = 1e9
SPREAD = np.full(2, 100.0)
COORDINATES: Any = SimpleNamespace(unit=np.ones(2), clip=lambda z: np.clip(z, -50.0, 50.0))

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Valley:
    """A filter whose samples have these residuals, with their derivatives by the parameters."""

    coordinates = COORDINATES

    def __init__(self, residuals: Residuals, z: np.ndarray) -> None:
        self.residuals, self.z = residuals, z

    def piece(self) -> Piece:
        error, slope = self.residuals(self.z)
        begin = State(np.zeros((1, 1)), 0.0, np.zeros(1))
        samples = Samples(np.array([0.5]), np.zeros((1, 1)), np.zeros((1, 1)))
        matrix = slope.T @ slope
        return Piece(matrix, matrix @ self.z - slope.T @ error, np.zeros((1, 1)), begin, samples, self.z, 1.0, SPREAD)

    def again(self, pieces, z, changed=False):
        self.z = z
        error = self.residuals(z)[0]
        return np.full(len(pieces), error @ error), [self.piece() for _ in pieces]

    def copy(self):
        return Valley(self.residuals, self.z)


def known(residuals: Residuals, z: list[float]) -> tuple[Any, Memory]:
    """A filter and the memory of its samples, near z."""
    valley = Valley(residuals, np.array(z))
    memory = Memory(np.zeros(2), np.diag(SPREAD**2), SPREAD)
    memory.add(valley.piece(), MEMORY_S)
    return valley, memory


def bent(along: float, across: float, bend: float) -> Residuals:
    """Of normal x and y - bend x^2 with these standard deviations."""

    def residuals(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        error = np.array([z[0] / along, (z[1] - bend * z[0] ** 2) / across])
        return error, np.array([[1.0 / along, 0.0], [-2.0 * bend * z[0] / across, 1.0 / across]])

    return residuals


def test_a_parabola_lacks_nothing():
    found = profiled(*known(bent(0.5, 0.1, 0.0), [0.0, 0.0]), COORDINATES, MEMORY_S)
    assert found is not None and not found.lower and not found.others
    for axis in found.axes:
        np.testing.assert_allclose(axis.excess, 0.0, atol=0.03 * axis.variance)


@pytest.mark.parametrize(("along", "bend"), [(0.5, 1.0), (2.5, 0.2)])
def test_a_bent_valley_widens_by_its_bend(along, bend):
    """By the fourth moment of a normal distribution: E (bend x^2)^2 = 3 bend^2 along^4."""
    found = profiled(*known(bent(along, 0.05, bend), [0.0, 0.0]), COORDINATES, MEMORY_S)
    assert found is not None
    excess = sum(axis.excess for axis in found.axes)
    assert excess[1, 1] == pytest.approx(3.0 * bend**2 * along**4, rel=0.3)
    assert excess[0, 0] < 0.1 * along**2


def flat(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of x whose cost is as at 0.1 near its minimum, and as at 1 farther away."""
    slope = np.array([[10.0 if abs(z[0]) < 0.05 else 1.0, 0.0], [0.0, 10.0]])
    return np.array([z[0] if abs(z[0]) > 0.05 else 10.0 * z[0], 10.0 * z[1]]), slope


def test_a_valley_that_is_wider_than_at_its_minimum_widens():
    found = profiled(*known(flat, [0.0, 0.0]), COORDINATES, MEMORY_S)
    assert found is not None
    sigma = np.sqrt(0.1**2 + sum(axis.excess for axis in found.axes)[0, 0])
    assert 0.25 < sigma < 1.0  # as far as eight steps of 0.1 tell


def two(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Four of these have a cost of 4 at x = 0.1 and of 0 at x = 2, with a hill of 10 between them."""
    x = z[0]
    error = np.array([x - 2.0, 3.0 * np.sin(0.5 * np.pi * x), 10.0 * z[1]])
    slope = np.array([[1.0, 0.0], [1.5 * np.pi * np.cos(0.5 * np.pi * x), 0.0], [0.0, 10.0]])
    return 0.5 * error, 0.5 * slope


def test_a_lower_minimum_is_told_once_and_another_one_widens_until_it_is_not_likely():
    valley, memory = known(two, [0.1, 0.0])
    search = ProfileSearch(COORDINATES, MEMORY_S, at_once)
    told, excess = {}, {}
    for count in range(1, 33):
        z = search.run(valley, memory)
        if z is not None:
            told[count], valley.z = z, z
            memory.replace(count * [valley.piece()], MEMORY_S)
        excess[count] = search.excess(memory.inverse)[0, 0]
        memory.add(valley.piece(), MEMORY_S)
    assert list(told) == [4] and told[4][0] == pytest.approx(2.0, abs=0.01)
    assert excess[3] == 0.0
    assert excess[4] == pytest.approx(1.9**2, rel=0.1) and excess[31] == pytest.approx(1.9**2, rel=0.1)
    assert excess[32] < 0.01  # its cost is higher by 30


def test_what_bends_shrinks_with_the_square_of_the_variance():
    valley, memory = known(bent(0.5, 0.05, 1.0), [0.0, 0.0])
    search = ProfileSearch(COORDINATES, MEMORY_S, at_once)
    for _ in range(3):
        memory.add(valley.piece(), MEMORY_S)
    search.run(valley, memory)
    now, later = (search.excess(memory.inverse / count)[1, 1] for count in (1, 10))
    assert later == pytest.approx(0.01 * now, rel=1e-3)
    assert search.anew().excess(memory.inverse).max() == 0.0
