"""Whether gravity acts where it is taken to, from samples as they arrive: what `other_gravity` does with recordings."""

from __future__ import annotations

from collections import deque

import numpy as np

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import DRIVES, POSITION
from joint_id_core.arm.gravity_direction import doubt, pull_of, pulled
from joint_id_core.data.instants import NANO
from joint_id_core.data.recording import Array

MOTION = (POSITION, "link_velocity", "link_acceleration")
# A pose counts if a joint is so far (rad, m) from the last one that counts, and so much later: rests tell nothing.
FAR, LATER_NS = 0.05, NANO // 10
POSES, EVERY = 300, 100  # newest ones that are looked at, after so many new ones each


class GravityWatch:
    """Keeps poses of an arm and compares their torques with gravity where it is taken to act.

    Attributes:
        doubt: that gravity acts elsewhere, as a sentence with the ROS parameter to set; empty if nothing says so.
    """

    def __init__(self, description: Description) -> None:
        """Watch the robot of a description. Without gravity there is nothing to watch."""
        self.doubt = ""
        self._description, self._watched = description, bool(description.gravity.any())
        self._poses: deque[Array] = deque(maxlen=POSES)  # position, velocity, acceleration, drive; shape (4, joints)
        self._drives: tuple[str, ...] = ()  # channels of the drives in these
        self._last_ns, self._new = 0, 0

    def add(self, samples: AlignedSamples) -> bool:
        """Take later samples of all joints, and return whether a check of their torques now doubts gravity."""
        drives = tuple(d for d in DRIVES if d in samples.channels and d not in samples.derived)
        names = list(samples.joints)
        if not self._watched or not drives or not set(self._description.joints) <= set(names):
            return False
        if drives != self._drives:  # amperes are no torques
            self._drives, self._new = drives, 0
            self._poses.clear()
        places = [names.index(name) for name in self._description.joints]
        for k, instant_ns in enumerate(samples.instants_ns):
            if 0 <= instant_ns - self._last_ns < LATER_NS:
                continue
            pose = np.array([samples.channels[name][k][places] for name in (*MOTION, drives[0])])
            if np.isfinite(pose[:3]).all() and self._far(pose[0]):
                self._poses.append(pose)
                self._last_ns, self._new = instant_ns, self._new + 1
        if self._new < EVERY:
            return False
        self._new, self.doubt = 0, self._checked()
        return bool(self.doubt)

    def _far(self, position: Array) -> bool:
        return not self._poses or bool(np.abs(position - self._poses[-1][0]).max() > FAR)

    def _checked(self) -> str:
        q, dq, ddq, drive = np.array(self._poses).transpose(1, 0, 2)
        drives = {j: drive[:, j] for j in range(drive.shape[1])}
        joints = pulled(self._description, pull_of(self._description), (q, dq, ddq), drives)
        return doubt(self._description, joints, "base_gravity", _assigned)


def _assigned(gravity: Array) -> str:
    """Return a gravity as it is assigned to a parameter of a node."""
    return f":=[{', '.join(str(float(v)) for v in np.round(gravity, 2) + 0.0)}]"
