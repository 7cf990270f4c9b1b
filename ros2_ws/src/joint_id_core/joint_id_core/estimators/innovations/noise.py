"""Noise levels that maximise the innovations likelihood, by Fisher scoring.

Parameters and noise levels each take their own step from the same pass. Yet they are not independent: the gain depends
on the levels, and in ordinary motion much of what is known of a joint comes from how it answers to noise. There
standard deviations at known levels were two times too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import credible_noise, input_noise, rough_noise

LARGEST_CHANGE = 20.0  # factor of a variance in one step: the information matrix holds only near the present levels
RIDGE = 1e-3  # information added on the logarithm of each level, so that a level without information does not move
UNKNOWN = 1.0  # standard deviation of the logarithm of a level that the data do not show
SHOWN_BY_POSITION = (1.1 / 2.0) ** 2  # largest noise variance of a recorded position over the largest credible one
SHOWN = 5.0  # information on the logarithm of a level above which the fit depends on this level


@dataclass(frozen=True)
class NoiseLevels:
    """Bounds of the noise variances of labels and inputs, each of shape (labels + inputs,).

    Lower bounds are the resolution of a label, and 1e-6 of the typical size of an input. The upper bound of a measured
    motion is the noise that the signal itself shows. A position that is an input may have hardly more than that: with
    twice as much, an inertia 1.4 times too large was as likely. The noise of a drive has no such upper bound: it stands
    for all errors of the torque, those of the model included.
    """

    data: FitData
    lower: Array
    upper: Array

    @classmethod
    def of(cls, data: FitData) -> NoiseLevels:
        """Return the bounds for a record."""
        table, span = data.table, data.span
        if table is not None:
            bounds = credible_noise(table, span)
        else:
            each = [credible_noise(row[None], span[k : k + 1]) for k, row in enumerate(data.rows)]
            bounds = np.concatenate(each, axis=1)
        drives = []
        for signal, values in zip(data.model.inputs, data.u.T, strict=True):
            least, most = (1e-6 * signal.scale) ** 2, (1e3 * signal.scale) ** 2
            if signal.hold == "first":
                most = float(credible_noise(values[None], np.ptp(values)[None])[1, 0])
                # a velocity may have been computed: behind a filter it does not show all of its noise
                most = max(least, most * SHOWN_BY_POSITION if signal.name.endswith("_position") else most)
            drives.append((least, most))
        lower, upper = np.ascontiguousarray(np.concatenate([bounds, np.array(drives).T], axis=1))
        return cls(data, lower, upper)

    @cached_property
    def rough(self) -> Array:
        """Rough levels to start a fit from, shape (labels + inputs,)."""
        data = self.data
        labels = [max(rough_noise(row), least) for row, least in zip(data.rows, self.lower, strict=False)]
        return np.array([*labels, *input_noise(data)])

    def clip(self, levels: Array) -> Array:
        """Return the nearest levels within the bounds."""
        return np.minimum(np.maximum(levels, self.lower), self.upper)


def bounded_step(
    kernel: Kernel, levels: Array, lower: Array, upper: Array, score: Array, information: Array
) -> tuple[Array, float]:
    """Compute one scoring step of the variances with the compiled `loops.noise.bounded_step`.

    score (L,) and information (L, L) are derivatives by the logarithms of the levels.

    Returns:
        The step in logarithms, shape (L,), and the decrement: its squared length in standard deviations of the levels.
    """
    step = np.empty_like(levels)
    decrement = kernel.gains.bounded_step(score, information, levels, lower, upper, LARGEST_CHANGE, RIDGE, step)
    return step, float(decrement)


class NoiseScoring:
    """Scoring steps of the noise levels, from the passes of one recursion.

    Attributes:
        information: information matrix of the latest step, by the logarithms of the levels, shape (L, L).
    """

    def __init__(self, recursion: Recursion, bounds: NoiseLevels) -> None:
        self.recursion, self.bounds = recursion, bounds
        self.information = np.zeros((len(bounds.lower), len(bounds.lower)))

    def step(self, last: Pass) -> tuple[Array, float]:
        """Return the step in logarithms from the latest pass, and its decrement: see `bounded_step`."""
        found, bounds = self.recursion.noise_information(last), self.bounds
        self.information = found.matrix
        return bounded_step(self.recursion.kernel, last.levels, bounds.lower, bounds.upper, found.score, found.matrix)

    def change(self, before: Array, after: Array) -> float:
        """Return the largest change of the logarithm of a level, among the levels that the data determine."""
        shown = np.diag(self.information) > SHOWN
        return float(np.max(np.abs(np.log(after / before)), where=shown, initial=0.0))


def with_prior(information: Array) -> Array:
    """Return the information (L, L) on the logarithms of the levels with what is believed before the data, UNKNOWN."""
    return information + np.diag(np.full(len(information), UNKNOWN**-2))


def covariance_of_levels(information: Array) -> Array:
    """Return the covariance of the logarithms of the levels, (L, L), from the information matrix on them, (L, L)."""
    return np.asarray(np.linalg.inv(with_prior(information)))


def unknown_levels(inverse: Array, information: Array, cross: Array) -> Array:
    """Return what the uncertainty of the noise levels adds to a covariance of parameters, shape (k, k).

    Parameters and logarithms of the levels together have the information matrix [[H, D], [D', L]]. The covariance of
    the parameters is the block (H - D L^-1 D')^-1 of its inverse, and here H^-1 is taken off. H is that of the Gauss-
    Newton step, so the matrix is never indefinite.

    Args:
        inverse: H^-1, shape (k, k), the covariance at known levels.
        information: L, shape (L, L).
        cross: D, shape (k, L).
    """
    known = with_prior(information)
    moved = inverse @ cross
    return np.asarray(moved @ np.linalg.solve(known - cross.T @ moved, moved.T))
