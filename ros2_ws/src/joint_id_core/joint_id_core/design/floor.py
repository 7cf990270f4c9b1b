"""How far the joints of an arm, and the ends of its links, are below a floor."""

from __future__ import annotations

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError


class Floor:
    """Depth of the origins of all moving frames of a description under a floor. Links are wider than these points."""

    def __init__(self, description: Description, height: float) -> None:
        """Take a height in m over the origin of the base, against gravity.

        Raises:
            JointIdError: without gravity nothing is up.
        """
        import pinocchio

        self._pinocchio, self._model, self._height = pinocchio, description.model, height
        self._data = self._model.createData()
        gravity = self._model.gravity.linear
        size = float(np.linalg.norm(gravity))
        if size == 0.0:
            raise JointIdError("a floor without gravity: give the direction of gravity (--base-gravity)")
        self._up = -gravity / size
        self._order = [description.column(name) for name in description.joints]
        # a joint and the link that it moves have one origin
        self._frames = [
            k for k, frame in enumerate(self._model.frames) if frame.parentJoint > 0 and frame.type == pinocchio.BODY
        ]

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Return depths in m (T, k), below 0 above the floor, and their derivatives (T, k, n), of poses (T, n)."""
        pinocchio, model, data = self._pinocchio, self._model, self._data
        moved = np.zeros_like(q)
        moved[:, self._order] = q
        depth = np.empty((len(q), len(self._frames)))
        slopes = np.empty((*depth.shape, q.shape[1]))
        aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        for t, pose in enumerate(moved):
            pinocchio.computeJointJacobians(model, data, pose)
            pinocchio.updateFramePlacements(model, data)
            for k, frame in enumerate(self._frames):
                depth[t, k] = self._height - self._up @ data.oMf[frame].translation
                jacobian = pinocchio.getFrameJacobian(model, data, frame, aligned)
                slopes[t, k] = -(self._up @ jacobian[:3])[self._order]
        return depth, slopes
