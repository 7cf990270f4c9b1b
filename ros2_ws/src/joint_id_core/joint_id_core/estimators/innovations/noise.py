"""Noise levels that maximise the innovations likelihood, by Fisher scoring beside the parameters.

The parameters and the noise levels of a prediction-error estimate are asymptotically uncorrelated (Ljung, System
Identification, 2nd ed., section 9.3), so each takes its own step from the same pass.
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

LARGEST_CHANGE = 20.0  # factor of a variance in one step: the information is only that of the present levels
RIDGE = 1e-3  # information added to the logarithm of each level, so that one which nothing shows stays where it is
SHOWN = 5.0  # information on the logarithm of a level from which the fit depends on it


@dataclass(frozen=True)
class NoiseLevels:
    """Bounds of the variances of labels and inputs, each of shape (labels + inputs,).

    Never below the resolution of a label or 1e-6 of the typical size of an input; for measured motions never above
    what the signal shows. The noise of a drive has no such bound: it stands for everything the model does not know
    about the torque.
    """

    data: FitData
    lower: Array
    upper: Array

    @classmethod
    def of(cls, data: FitData) -> NoiseLevels:
        """The levels for one data."""
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
                most = max(least, float(credible_noise(values[None], np.ptp(values)[None])[1, 0]))
            drives.append((least, most))
        lower, upper = np.ascontiguousarray(np.concatenate([bounds, np.array(drives).T], axis=1))
        return cls(data, lower, upper)

    @cached_property
    def rough(self) -> Array:
        """Rough levels to start from."""
        data = self.data
        labels = [max(rough_noise(row), least) for row, least in zip(data.rows, self.lower, strict=False)]
        return np.array([*labels, *input_noise(data)])

    def clip(self, levels: Array) -> Array:
        """The nearest levels within the bounds."""
        return np.minimum(np.maximum(levels, self.lower), self.upper)


def bounded_step(
    kernel: Kernel, levels: Array, lower: Array, upper: Array, score: Array, information: Array
) -> tuple[Array, float]:
    """One scoring step in the variances, by the compiled `loops.noise.bounded_step`.

    score (L,) and information (L, L) are by the logarithms of the levels.

    Returns:
        The step in logarithms, and the decrement: its squared length in units of the levels' uncertainty.
    """
    step = np.empty_like(levels)
    decrement = kernel.gains.bounded_step(score, information, levels, lower, upper, LARGEST_CHANGE, RIDGE, step)
    return step, float(decrement)


class NoiseScoring:
    """Steps of the noise levels beside the passes of one recursion; `information` (L, L) is that of the latest step."""

    def __init__(self, recursion: Recursion, bounds: NoiseLevels) -> None:
        self.recursion, self.bounds = recursion, bounds
        self.information = np.zeros((len(bounds.lower), len(bounds.lower)))

    def step(self, last: Pass) -> tuple[Array, float]:
        """The step in logarithms from the latest pass, and its decrement: see `bounded_step`."""
        score, self.information = self.recursion.noise_information(last)
        bounds = self.bounds
        return bounded_step(self.recursion.kernel, last.levels, bounds.lower, bounds.upper, score, self.information)

    def change(self, before: Array, after: Array) -> float:
        """Largest change of the logarithm of a level, of those that the data show."""
        shown = np.diag(self.information) > SHOWN
        return float(np.max(np.abs(np.log(after / before)), where=shown, initial=0.0))
