"""Noise levels that maximise the innovations likelihood, by Fisher scoring beside the parameters.

The parameters and the noise levels of a prediction-error estimate are asymptotically uncorrelated (Ljung, System
Identification, 2nd ed., section 9.3), so each takes its own step from the same pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.codegen import Kernel
from joint_id_core.estimate import NoiseInformation
from joint_id_core.estimators.recursion import Pass, Recursion
from joint_id_core.estimators.start import Roughness, input_noise
from joint_id_core.problem import Problem
from joint_id_core.recording import Array

LARGEST_CHANGE = 20.0  # factor of a variance in one step: the information is only that of the present levels
RIDGE = 1e-3  # information added to the logarithm of each level, so that one which nothing shows stays where it is
HOLDS = 0.25  # relative change of what single samples say of a level up to which the information matrix is kept


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
        rough, lower, upper = np.ascontiguousarray(np.array(rows).T)
        return cls(rough, lower, np.maximum(lower, upper))

    def clip(self, levels: Array) -> Array:
        """The nearest levels within the bounds."""
        return np.clip(levels, self.lower, self.upper)

    def step(self, kernel: Kernel, levels: Array, score: Array, information: Array) -> tuple[Array, float]:
        """One scoring step in the variances, by the compiled `gain_recursions.bounded_step`.

        score (L,) and information (L, L) are by the logarithms of the levels.

        Returns:
            The step in logarithms, and the decrement: its squared length in units of the levels' uncertainty.
        """
        step = np.empty_like(levels)
        decrement = kernel.gains.bounded_step(
            score, information, levels, self.lower, self.upper, LARGEST_CHANGE, RIDGE, step
        )
        return step, float(decrement)


class NoiseScoring:
    """Steps of the noise levels beside the passes of one recursion.

    The score is that of each pass. The information matrix costs ten times as much and only shapes the step: it is kept
    while what single samples say of each level stays the same, also from an earlier window.

    Attributes:
        bounds: of the levels.
        known: the latest information, or an earlier one that is believed to hold; None before the first step.
    """

    def __init__(self, recursion: Recursion, bounds: NoiseLevels, known: NoiseInformation | None = None) -> None:
        self.recursion, self.bounds, self.known = recursion, bounds, known

    def step(self, last: Pass) -> tuple[Array, float]:
        """The step in logarithms from the latest pass, and its decrement: see `NoiseLevels.step`."""
        score, least = self.recursion.noise_score(last)
        if self.known is None or np.any(np.abs(least - self.known.least) > HOLDS * self.known.least + RIDGE):
            self.known = NoiseInformation(self.recursion.noise_information(last), least)
        return self.bounds.step(self.recursion.kernel, last.levels, score, self.known.matrix)
