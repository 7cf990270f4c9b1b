"""What the load of a joint may be off by, as the bodies of a description are not those of the robot.

A maker's masses are rounded, cables and tools are missing, and torque constants are known to some 10 to 20 %. With the
stock description of a UR10e, the load of its elbow is 16 % too small for the torque constant that its users take, and
nothing can be known of its friction. What remains certain is the geometry: any masses give torques that are linear in
them, with factors that follow from the motion (see `arm.regressor`).
"""

from __future__ import annotations

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.regressor import OF_LINK, Regressor
from joint_id_core.arm.typical_inertia import typical_poses
from joint_id_core.data.load_errors import LoadErrors
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

SHARE = 0.3  # standard deviation of a mass, of first moments and inertias as far as the mass makes them
SCALE = 0.2  # the same of the whole load, in units of a torque that is current times a constant
# Sizes that a body has at least, over the means of all: a tool or cables may be missing in the description.
LEAST_MASS, LEAST_LEVER = 0.1, 0.5
LITTLE = 1e-3  # size of an error over that of the largest one that does not count
RATE_HZ = 100.0  # of the samples at which they are computed: loads of an arm are slower than 10 Hz


class Errors:
    """What the load of a joint may be off by; nothing is told if a joint of the description follows another one.

    Args:
        description, joint: of the arm, and whose load it is.
    """

    def __init__(self, description: Description, joint: str) -> None:
        self._joint, self._of = description.joints.index(joint), f"the load of {joint} by {description.source}"
        try:
            self._regressor: Regressor | None = Regressor(description)
        except JointIdError:
            self._regressor = None
            return
        poses = typical_poses(description)
        still, moved = np.zeros_like(poses), np.zeros_like(poses)
        moved[:, self._joint] = 1.0
        inertia = self._rows(poses, still, moved) - self._rows(poses, still, still)
        self._kept_inertia = inertia.mean(axis=0)  # stays with the model, as the typical inertia does
        rng = np.random.default_rng(0)
        speed, rate = rng.standard_normal((2, *poses.shape))  # rad/s, rad/s^2
        ways = _one_sigma(self._regressor)
        _, sizes, turned = np.linalg.svd(self._torques(poses, speed, rate) @ ways, full_matrices=False)
        self._ways = ways @ turned[sizes > LITTLE * sizes[0]].T

    def along(self, time: Array, motion: tuple[Array, Array, Array]) -> LoadErrors | None:
        """Return the errors at instants (T,) in s; motion: positions, velocities, accelerations, each (T, n)."""
        if self._regressor is None:
            return None
        known = np.flatnonzero(np.all([np.isfinite(part).all(axis=1) for part in motion], axis=0))
        period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        rows = known[:: max(1, round(1.0 / (RATE_HZ * period)))]
        return LoadErrors(time[rows], self._torques(*(part[rows] for part in motion)) @ self._ways, self._of)

    def _torques(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the load by unit base parameters, shape (T, B)."""
        return self._rows(q, dq, ddq) - np.outer(ddq[:, self._joint], self._kept_inertia)

    def _rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        assert self._regressor is not None
        return self._regressor.rows(q, dq, ddq)[0][:, self._joint]


def _one_sigma(regressor: Regressor) -> Array:
    """Return independent directions of the B base parameters, each of one standard deviation, shape (B, B)."""
    masses, levers = regressor.bodies[:, 0], np.array([_lever(body) for body in regressor.bodies])
    masses = np.maximum(masses, LEAST_MASS * masses.mean())
    levers = np.maximum(levers, LEAST_LEVER * levers.mean())
    powers = [0 if part == "mass" else 1 if part.startswith("m") else 2 for part in OF_LINK]
    sigma = SHARE * masses[:, None] * levers[:, None] ** powers
    spread = regressor.composition[:, len(regressor.joints) :] * sigma.ravel()
    of_all = SCALE * regressor.reference
    values, vectors = np.linalg.eigh(spread @ spread.T + np.outer(of_all, of_all))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _lever(body: Array) -> float:
    """Return the distance of a body's mass from its joint's frame: its radius of gyration about the origin, in m."""
    mass, spread = body[0], body[4] + body[6] + body[9]
    return float(np.sqrt(max(0.0, 0.5 * spread / mass))) if mass > 0.0 else 0.0
