"""Noise levels that maximise the innovations likelihood, by Fisher scoring beside the parameters.

The parameters and the noise levels of a prediction-error estimate are asymptotically uncorrelated (Ljung, System
Identification, 2nd ed., section 9.3), so each takes its own step from the same pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.estimators.start import Roughness, input_noise
from joint_id_core.problem import Problem
from joint_id_core.recording import Array

LARGEST_CHANGE = 20.0  # factor of a variance in one step: the information is only that of the present levels
RIDGE = 1e-3  # information added to the logarithm of each level, so that one which nothing shows stays where it is


@dataclass(frozen=True)
class NoiseLevels:
    """Variances of labels and inputs, each of shape (labels + inputs,): rough ones to start from, and their bounds.

    Never below the resolution of a label or 1e-6 of the typical size of an input; for measured motions never above
    what the signal shows. The noise of a drive has no such bound: it stands for everything the model does not know
    about the torque.
    """

    rough: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, problem: Problem) -> NoiseLevels:
        """The levels for one problem."""
        shown = [Roughness.of(column) for column in problem.y.T]
        rows = [(r.noise, r.floor, r.ceiling) for r in shown]
        for signal, values, start in zip(problem.model.inputs, problem.u.T, input_noise(problem), strict=True):
            ceiling = Roughness.of(values).ceiling if signal.hold == "first" else (1e3 * signal.scale) ** 2
            rows.append((float(start), (1e-6 * signal.scale) ** 2, ceiling))
        rough, lower, upper = np.array(rows).T
        return cls(rough, lower, np.maximum(lower, upper))

    def clip(self, levels: Array) -> Array:
        """The nearest levels within the bounds."""
        return np.clip(levels, self.lower, self.upper)

    def step(self, levels: Array, score: Array, information: Array) -> tuple[Array, float]:
        """One scoring step in the variances.

        Returns:
            The step in logarithms, and the decrement: its squared length in units of the levels' uncertainty.
        """
        slope, matrix = score * levels, information * np.outer(levels, levels)
        least = np.maximum(1.0 / LARGEST_CHANGE, self.lower / levels) - 1.0
        most = np.minimum(LARGEST_CHANGE, self.upper / levels) - 1.0
        change, held = np.zeros_like(levels), np.zeros(len(levels), dtype=bool)
        for _ in levels:
            free = ~held
            block = matrix[np.ix_(free, free)] + RIDGE * np.eye(int(free.sum()))
            change[free] = np.linalg.solve(block, (slope - matrix[:, held] @ change[held])[free])
            beyond = free & ((change < least) | (change > most))
            if not beyond.any():
                break
            # the others take their step beside what these are allowed to
            change[beyond] = np.clip(change[beyond], least[beyond], most[beyond])
            held |= beyond
            if held.all():
                break
        step = np.log1p(change)
        return step, float(step @ matrix @ step)
