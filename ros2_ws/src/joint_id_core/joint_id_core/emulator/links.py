"""The links of an emulated arm: rigid bodies from a robot's description, and what the last of them carries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import JOINTS

GRIP = (0.03, 0.0, 0.1)  # m, where a payload is, in the frame of the link that the last joint moves


class RigidLinks:
    """Six links one after the other; see `simulation.coupled_joints.Links`.

    Attributes:
        carried: mass in kg that the last link carries.

    Args:
        description: of the robot.

    Raises:
        JointIdError: see `require_six_joints`.
    """

    def __init__(self, description: Description) -> None:
        import pinocchio

        require_six_joints(description)
        self._pinocchio, self._nominal = pinocchio, description.model
        self._model = pinocchio.Model(description.model)
        self._data = self._model.createData()
        self.carried = 0.0

    def dynamics(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the mass matrix and the torques of gravity and velocities, with the payload."""
        inertia = self._pinocchio.crba(self._model, self._data, q)
        return inertia, self._pinocchio.nonLinearEffects(self._model, self._data, q, dq)

    def needed(self, q: Sequence[float], dq: Sequence[float], ddq: Sequence[float]) -> Array:
        """Return the torques of a motion without payload, which the controller does not know, in Nm, shape (6,)."""
        motion = (np.asarray(row, dtype=float) for row in (q, dq, ddq))
        found: Array = self._pinocchio.rnea(self._nominal, self._data, *motion)
        return found

    def carry(self, mass: float) -> None:
        """Let the last link carry a point mass in kg at `GRIP`, in place of what it carried; 0: nothing."""
        self.carried = mass
        load = self._pinocchio.Inertia(mass, np.array(GRIP), np.zeros((3, 3)))
        self._model.inertias[JOINTS] = self._nominal.inertias[JOINTS] + load


def require_six_joints(description: Description) -> None:
    """Check that an arm has six joints, all turning, one after the other.

    Raises:
        JointIdError: it has not; the message says what is different.
    """
    model, source = description.model, description.source
    if len(description.joints) != JOINTS:
        raise JointIdError(
            f"{source}: {len(description.joints)} joints move ({', '.join(description.joints)}), those of the emulated "
            f"robot are {JOINTS}: make others fixed in a copy"
        )
    if description.mimics:
        raise JointIdError(
            f"{source}: {', '.join(description.mimics)} follows another joint (mimic): make it fixed in a copy"
        )
    for k, name in enumerate(description.joints, 1):
        if not model.joints[k].shortname().startswith("JointModelR"):
            raise JointIdError(f"{source}: joint {name} does not turn: the joints of the emulated robot do")
        if model.parents[k] != k - 1:
            raise JointIdError(f"{source}: joint {name} does not follow {description.joints[k - 2]}: the arm branches")
