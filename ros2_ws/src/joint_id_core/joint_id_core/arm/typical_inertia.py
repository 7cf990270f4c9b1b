"""The inertia of the links that models of one joint keep: a constant of the robot's description.

Models of one joint have a constant inertia, and that of an arm changes with its pose. So they keep a typical one, and
what differs from it is load. It must not depend on the motion: estimates of other days, and those online, are of the
same quantity.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.data.recording import Array

POSES = 1024  # over which the mean is taken; it is then known to about 0.1 %


def typical_inertia(description: Description) -> Array:
    """Return the mean over all poses of the inertia that each joint moves, in kg m^2 (or kg), shape (joints,)."""
    poses = typical_poses(description)
    still = np.zeros_like(poses)
    inertia: Array = description.loads(poses, still, still).inertia.mean(axis=0)
    return inertia


def typical_poses(description: Description) -> Array:
    """Return positions of all joints that stand for all poses, shape (POSES, joints).

    Joints that turn do so over a full turn, whatever their limits; sliding ones are at 0. The zero pose would be no
    better: in that of many arms some joints carry nearly no inertia, as links stand on their axes. The poses are those
    of a sequence of low discrepancy, which is the same on every computer (Richtmyer; Niederreiter, Random Number
    Generation and Quasi-Monte Carlo Methods, 1992, ch. 3, with powers of the root of x^(n + 1) = x + 1).
    """
    turns = description.turning
    count = len(turns)
    root = 1.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (count + 1))
    steps = root ** -np.arange(1.0, count + 1.0)
    return np.where(turns, 2.0 * np.pi * (np.outer(np.arange(1, POSES + 1), steps) % 1.0), 0.0)
