"""How sharp the friction of the online filter is.

Over minutes, the creep of a sticking joint under smoothed friction would bias the estimates by several standard
deviations. The filter follows a path that it knows well, so it can have sharper friction than a fit from afar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.substeps import KINK, MORE_STEPS, MOST_STEPS, MOST_TURNING, steps_to_stand

SHARPEST = 0.1
# RK4 needs more steps there while a joint sticks: with too few, a path that had gone unstable came back 70 standard
# deviations off.
MOST_SHARP_STEPS = 1024
KNOWN = 0.5  # largest standard deviation of a coordinate at which friction is as smooth as in a fit


@dataclass(frozen=True)
class Friction:
    """Friction of some sharpness.

    Attributes:
        smoothing: factor on the smoothing velocities of a fit.
        velocities: these velocities, of those that are sharpened.
        stiff, many, turning, most: as in `loops.tracking.track`.
    """

    smoothing: float
    velocities: Array
    stiff: Array
    many: int
    turning: Array
    most: int = MOST_TURNING


class Sharpness:
    """Finds the friction that suits what is known.

    Args:
        data: a window of motion.
        kernel: compiled cell of its model.
        substeps: integrator steps per sample where friction is not stiff.
        held: parameters that keep the value of the user, so that their friction is not sharpened.

    Attributes:
        sharpened: indices of the smoothing velocities that change.
    """

    def __init__(self, data: FitData, kernel: Kernel, substeps: int, held: frozenset[str]) -> None:
        names = [n for n in data.model.smoothing.values() if n not in held and n not in data.free]
        self.sharpened = [data.model.parameter_names.index(name) for name in names]
        self._data, self._kernel, self._substeps = data, kernel, substeps
        self._states = rough_states(data)

    def of(self, sigma: float, p: Array) -> Friction:
        """Return friction for the largest standard deviation `sigma` of a coordinate, at all parameters p (P,)."""
        return self.smoothed(float(np.clip(sigma / KNOWN, SHARPEST, 1.0)) if self.sharpened else 1.0, p)

    def smoothed(self, smoothing: float, p: Array) -> Friction:
        """Return friction whose smoothing velocities are those of a fit times `smoothing`, and the steps it needs."""
        data, p = self._data, p.copy()
        p[self.sharpened] = data.p[self.sharpened] * smoothing
        stiff, turning = np.full(len(data.model.states), -1.0), np.full(len(data.model.states), -1.0)
        for velocity, name in data.model.smoothing.items():
            state, at = data.model.state_names.index(velocity), data.model.parameter_names.index(name)
            stiff[state], turning[state] = KINK * p[at], data.p[at]
        stable = steps_to_stand(data, self._kernel, p, self._states, self._substeps, MOST_SHARP_STEPS)
        many = max(stable, min(MOST_STEPS, round(MORE_STEPS * self._substeps / smoothing)))
        return Friction(smoothing, p[self.sharpened], stiff, many, turning)
