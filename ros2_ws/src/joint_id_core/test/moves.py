"""Ordinary work of a joint: moves from point to point, with rests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.simulation.minimum_jerk import minimum_jerk


@dataclass(frozen=True)
class Moves:
    """Moves of least jerk to the next of `points` in rad, from instants `begins` on, `seconds` long; then it rests."""

    begins: np.ndarray
    seconds: np.ndarray
    points: np.ndarray

    def value(self, time: float) -> float:
        k, x = self._at(time)
        return float(self.points[k] + (self.points[k + 1] - self.points[k]) * minimum_jerk(x)[0])

    def rate(self, time: float) -> float:
        k, x = self._at(time)
        return float((self.points[k + 1] - self.points[k]) * minimum_jerk(x)[1] / self.seconds[k])

    def _at(self, time: float) -> tuple[int, float]:
        k = max(0, int(np.searchsorted(self.begins, time, "right")) - 1)
        return k, min(1.0, (time - self.begins[k]) / self.seconds[k])


def random_moves(seed: int, count: int = 40, longest_s: float = 2.0, longest_rest_s: float = 1.0) -> Moves:
    """Moves of 0.4 s to `longest_s` to points within 1 rad, with rests of up to `longest_rest_s`."""
    rng = np.random.default_rng(seed)
    seconds, rests = rng.uniform(0.4, longest_s, count), rng.uniform(0.0, longest_rest_s, count)
    begins = np.concatenate([[0.0], np.cumsum(seconds + rests)[:-1]])
    return Moves(begins, seconds, np.array([0.0, *rng.uniform(-1.0, 1.0, count)]))


def repeated_moves(places: Sequence[float], move_s: float, rest_s: float, count: int = 40) -> Moves:
    """Moves of `move_s` from one of `places` to the next, over and over, with rests of `rest_s`."""
    begins = np.arange(count) * (move_s + rest_s)
    return Moves(begins, np.full(count, move_s), np.array([places[k % len(places)] for k in range(count + 1)]))
