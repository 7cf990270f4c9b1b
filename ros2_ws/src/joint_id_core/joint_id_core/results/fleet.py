"""Joints of a fleet that are not like the same joint of the other robots.

Of each robot, joint and parameter one value is taken: the weighted mean of its estimates. It lies apart when it is
further from the median of the other robots than chance explains:

    |value - median| > t * sqrt(sigma^2 + spread^2),  spread = 1.4826 MAD of the other robots (about their median),

with sigma of the value, and t the quantile of Student's t at which one in a hundred fleets without such a joint has one
that is called so, for each joint and parameter (Bonferroni over the robots). The median and the MAD of a few robots are
less certain than mean and standard deviation: t has 0.35 (robots - 1) degrees of freedom, found by simulation of normal
fleets of 5 to 100 robots; it is 35 for 6 robots, 12 for 10 and 6.4 for 20.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from joint_id_core.data.quantities import with_deviation
from joint_id_core.data.recording import Array
from joint_id_core.results.history import Course

FEWEST = 6  # robots: fewer do not tell what is usual
FALSE_ALARMS = 0.01  # of a joint and parameter of the whole fleet
FREEDOM = 0.35  # degrees of freedom of the spread for each other robot
MAD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


@dataclass(frozen=True)
class Apart:
    """A joint that is not like the same joint of other robots.

    Attributes:
        robot, joint, name, unit: what lies apart.
        value, std_dev: of this robot, in `unit`; median, spread: of the others.
        others: how many there are.
    """

    robot: str
    joint: str
    name: str
    unit: str
    value: float
    std_dev: float
    median: float
    spread: float
    others: int

    @property
    def text(self) -> str:
        """It in words."""
        return (
            f"{self.robot}: {self.joint}, {self.name} is {with_deviation(self.value, self.std_dev, self.unit)}, "
            f"{self.others} others have {with_deviation(self.median, self.spread)}"
        )


def apart(found: Sequence[Course]) -> list[Apart]:
    """Return what lies apart; nothing of joints that fewer than `FEWEST` robots have."""
    kinds: dict[tuple[str, str, str], list[Course]] = {}
    for c in found:
        if c.robot:
            kinds.setdefault((c.joint, c.model, c.name), []).append(c)
    outliers = []
    for (joint, _, name), of_robots in kinds.items():
        if len(of_robots) < FEWEST:
            continue
        means = [_mean(c) for c in of_robots]
        values, sigmas = np.array([m[0] for m in means]), np.array([m[1] for m in means])
        centres, spreads = of_others(values)
        far = np.abs(values - centres) > limit(len(values)) * np.hypot(sigmas, spreads)
        outliers += [
            Apart(of_robots[k].robot, joint, name, of_robots[k].unit, values[k], sigmas[k], centres[k], spreads[k],
                  len(values) - 1)
            for k in np.flatnonzero(far)
        ]  # fmt: skip
    return outliers


def limit(robots: int) -> float:
    """Return the distance from which on one of so many robots lies apart, in standard deviations."""
    return float(scipy.stats.t.isf(0.5 * FALSE_ALARMS / robots, FREEDOM * (robots - 1)))


def of_others(values: Array) -> tuple[Array, Array]:
    """Return median and spread of the others for each of the values, shape (n,)."""
    others = np.array([np.delete(values, k) for k in range(len(values))])
    centres = np.median(others, axis=1)
    return centres, MAD * np.median(np.abs(others - centres[:, None]), axis=1)


def _mean(c: Course) -> tuple[float, float]:
    """Return the weighted mean of a course and its standard deviation, wider where the values scatter more."""
    weights = c.std_devs**-2
    mean = float(np.average(c.values, weights=weights))
    sigma = 1.0 / math.sqrt(float(weights.sum()))
    if len(c.values) > 1:
        chi2 = float(np.sum(weights * (c.values - mean) ** 2)) / (len(c.values) - 1)
        sigma *= math.sqrt(max(1.0, chi2))
    return mean, sigma
