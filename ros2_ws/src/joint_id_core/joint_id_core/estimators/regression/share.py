"""By how much of a sample the drive of an equation comes late: see `shared.mean_drive`.

A drive that changes between samples, and is taken for held, looks like viscous friction, and takes its product with
the delay off the inertia. To first order the delay is one more parameter, whose column is the change of the drive in a
sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.least_squares import Solution
from joint_id_core.estimators.shared.mean_drive import LEAST, mean_square_share

SURE = 6.0  # standard deviations from which a drive is late


@dataclass(frozen=True)
class Share:
    """The share of the next sample that is most likely beside all parameters.

    Attributes:
        value, sigma: with its standard deviation.
        effect: change of the parameters with a share of 1, shape (k,).
    """

    value: float
    sigma: float
    effect: Array

    @property
    def sure(self) -> bool:
        """Whether the drive was not held."""
        return self.value > max(SURE * self.sigma, LEAST)

    def doubt(self, taken: bool) -> Array:
        """Return what it may change of the parameters, shape (k,): of a drive taken for held, or with a share.

        A share that is taken may be that of another estimator: what is left of it beside all parameters is in doubt.
        So is a drive that comes early, which no share describes.
        """
        if taken or self.value < -SURE * self.sigma:
            square = max(self.value**2, self.sigma**2)
        else:
            square = mean_square_share(self.value, self.sigma**-2)
        return np.asarray(np.sqrt(square) * self.effect)


def share_beside(
    y: Array, columns: Array, change: Array, ask: Callable[[Array, Array], Solution], count: int
) -> Share | None:  # fmt: skip
    """Return the share beside the parameters of an equation; None if nothing shows it.

    Args:
        y, columns: of the equation, shapes (R,) and (R, k).
        change: of the drive's part of y in a sample, shape (R,).
        ask: solves an equation y = columns.
        count: of the parameters; more columns are of what is fitted beside them.
    """
    found = ask(y, np.column_stack([columns, -change]))
    variance = float(found.covariance[-1, -1])
    if found.unseen[-1] or not variance > 0.0:
        return None
    effect = np.linalg.lstsq(columns, change, rcond=None)[0][:count]
    return Share(float(found.values[-1]), variance**0.5, np.asarray(effect))
