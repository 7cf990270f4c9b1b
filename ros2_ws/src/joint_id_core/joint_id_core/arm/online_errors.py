"""What computed loads may be off by, added to the samples of all joints of an arm as they arrive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.load_errors import errors_of
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import computed

MOTION = ("link_position", "link_velocity", "link_acceleration")


class OnlineErrors:
    """Adds them to the samples of joints whose load was computed.

    That needs the motion of all joints of the description at the instants of the samples; without it they stay as they
    are.
    """

    def __init__(self, description: Description) -> None:
        """Prepare, which takes a tenth of a second a joint."""
        self._errors = errors_of(description)
        self._joints = [] if self._errors is None else [n for n in description.joints if _has_load(description, n)]
        self._moving = description.joints
        if self._errors is not None:
            self._errors.prepare(self._joints)

    def attached(self, recordings: Mapping[str, Recording]) -> dict[str, Recording]:
        """Return the newest samples of joints, by name, with what their load may be off by."""
        found = dict(recordings)
        loaded = [name for name in self._joints if name in found and computed(found[name])]
        moved = [found.get(name) for name in self._moving]
        if self._errors is None or not loaded or any(one is None for one in moved):
            return found
        time, known = found[loaded[0]].time, [one for one in moved if one is not None]
        if any(not np.array_equal(one.time, time) or any(n not in one for n in MOTION) for one in known):
            return found
        q, dq, ddq = (np.column_stack([one[name] for one in known]) for name in MOTION)
        for name, errors in self._errors.along(loaded, time, (q, dq, ddq)).items():
            if len(errors.time):
                found[name] = found[name].with_load_errors(errors)
        return found


def _has_load(description: Description, joint: str) -> bool:
    try:
        description.require(joint)
    except JointIdError:
        return False
    return True
