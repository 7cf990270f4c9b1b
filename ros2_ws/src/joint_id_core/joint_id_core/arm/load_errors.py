"""What the load of a joint may be off by, as the bodies of a description are not those of the robot.

A maker's masses are rounded, cables and tools are missing, and torque constants are known to some 10 to 20 %. With the
stock description of a UR10e, the load of its elbow is 16 % too small for the torque constant that its users take, and
nothing can be known of its friction. What remains certain is the geometry: any masses give torques that are linear in
them, with factors that follow from the motion (see `arm.regressor`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from joint_id_core.arm.beforehand import ways
from joint_id_core.arm.description import Description
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.typical_inertia import typical_poses
from joint_id_core.data.load_errors import SampledErrors
from joint_id_core.data.recording import Array

SHARE = 0.3  # standard deviation of a mass, of first moments and inertias as far as the mass makes them
SCALE = 0.2  # the same of the whole load, in units of a torque that is current times a constant
LITTLE = 1e-3  # size of an error over that of the largest one that does not count
STATES = 256  # random ones that show which errors count
RATE_HZ = 100.0  # of the samples at which they are computed: loads of an arm are slower than 10 Hz


class Errors:
    """What the loads of the joints of an arm may be off by.

    Args:
        description: of the arm.

    Raises:
        JointIdError: a joint of it follows another one.
    """

    def __init__(self, description: Description) -> None:
        self._regressor, self._description = Regressor(description), description
        self._sigma = _one_sigma(self._regressor)
        self._joints: dict[int, _OfJoint] = {}

    def along(self, joints: Sequence[str], time: Array, motion: tuple[Array, Array, Array]) -> dict[str, SampledErrors]:
        """Return the errors of the loads of some joints at instants (T,) in s, where the motion is known.

        Args:
            joints: of the description.
            time: of the samples.
            motion: positions, velocities and accelerations of all joints of the description, shapes (T, n).
        """
        known = np.flatnonzero(np.all([np.isfinite(part).all(axis=1) for part in motion], axis=0))
        period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        rows = known[:: max(1, round(1.0 / (RATE_HZ * period)))]
        q, dq, ddq = (part[rows] for part in motion)
        torques = self._regressor.rows(q, dq, ddq)[0]
        found = {}
        for name in joints:
            k = self._description.joints.index(name)
            of_joint = self._of_joint(k)
            own = torques[:, k] - np.outer(ddq[:, k], of_joint.inertia)
            found[name] = SampledErrors(time[rows], own @ of_joint.ways, self.of(name))
        return found

    def of(self, joint: str) -> str:
        """Return what the errors of a joint are of, in words."""
        return f"the load of {joint} by {self._description.source}"

    def any_of(self, joint: str) -> bool:
        """Return whether the load of a joint can be off: that of a single joint with a vertical axis is always zero."""
        return self._of_joint(self._description.joints.index(joint)).ways.shape[1] > 0

    def prepare(self, joints: Sequence[str]) -> None:
        """Compute what `along` needs of these joints; else it takes a tenth of a second for each at its first call."""
        for name in joints:
            self._of_joint(self._description.joints.index(name))

    @cached_property
    def _at_rest(self) -> tuple[Array, Array]:
        """Typical poses (P, n), and the torques of all joints there by unit base parameters, shape (P, n, B)."""
        poses = typical_poses(self._description)
        still = np.zeros_like(poses)
        return poses, self._regressor.rows(poses, still, still)[0]

    def _of_joint(self, k: int) -> _OfJoint:
        if k not in self._joints:
            poses, resting = self._at_rest
            moved = np.zeros_like(poses)
            moved[:, k] = 1.0
            rows = self._regressor.rows
            inertia = (rows(poses, np.zeros_like(poses), moved)[0] - resting)[:, k].mean(axis=0)
            poses = poses[:STATES]
            speed, rate = np.random.default_rng(0).standard_normal((2, *poses.shape))  # rad/s, rad/s^2
            torques = rows(poses, speed, rate)[0][:, k] - np.outer(rate[:, k], inertia)
            _, sizes, turned = np.linalg.svd(torques @ self._sigma, full_matrices=False)
            self._joints[k] = _OfJoint(inertia, self._sigma @ turned[sizes > LITTLE * sizes[0]].T)
        return self._joints[k]


class _OfJoint(NamedTuple):
    """What unit base parameters add to the typical inertia, (B,), and the directions (B, m) that the load shows.

    That inertia stays with the model.
    """

    inertia: Array
    ways: Array


def errors_of(description: Description) -> Errors | None:
    """Return the errors of the loads of an arm; None if nothing can be told of them, as joints follow other ones."""
    return None if description.mimics else Errors(description)


def _one_sigma(regressor: Regressor) -> Array:
    """Return independent directions of the B base parameters, each of one standard deviation, shape (B, B)."""
    spread, of_all = ways(regressor, SHARE), SCALE * regressor.reference
    values, vectors = np.linalg.eigh(spread @ spread.T + np.outer(of_all, of_all))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
