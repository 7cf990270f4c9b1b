"""Other joints of a robot that move at the same time, whose load on a joint nobody knows."""

from __future__ import annotations

import math
from collections.abc import Mapping

from joint_id_core.checking.signals import GOES, known
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.estimators.shared.sentences import listed
from joint_id_core.models import Model
from joint_id_core.results.estimate import MOST_SENTENCES, Estimate, message

POSITIONS = tuple(name for name in CHANNELS if name.endswith("_position"))
TEXT = (
    "Other joints move, too ({}), and their load on this one is not known: give the robot's description (parameter "
    "urdf or description_topic), or move one joint at a time."
)


class OthersMoving:
    """Watches the positions of all joints of a robot.

    No window of one joint shows what the others do to it: their gravity and inertia look like friction, inertia or
    gravity of its own.
    """

    def __init__(self) -> None:
        self._told: dict[str, tuple[object, tuple[str, ...], str]] = {}  # by joint: basis, notes, message
        self._moved: dict[str, float] = {}  # newest instant in s at which a joint moved
        self._from: dict[tuple[str, str], float] = {}  # positions from there

    def take(self, recordings: Mapping[str, Recording]) -> None:
        """Take the newest samples of all joints, by name."""
        for joint, recording in recordings.items():
            for channel in POSITIONS if len(recording) else ():
                measured = channel in recording and channel not in recording.derived
                if measured and self._goes(joint, channel, recording.channels[channel]):
                    self._moved[joint] = float(recording.time[-1])

    def _goes(self, joint: str, channel: str, positions: Array) -> bool:
        """Return whether a position went further than that of a joint that is shaken, since it last did."""
        newest = float(positions[-1])  # a motion that goes there and back within a batch is no motion of a robot
        if math.isnan(newest):
            measured = known(positions)
            if not len(measured):
                return False
            newest = float(measured[-1])
        begin = self._from.setdefault((joint, channel), newest)
        if abs(newest - begin) <= GOES["position"] * CHANNELS[channel].scale:
            return False
        self._from[joint, channel] = newest
        return True

    def told(self, joint: str, estimate: Estimate, samples: Recording, model: Model) -> Estimate:
        """Return an estimate that names the joints that moved meanwhile, if their load counts and is not known.

        `samples` are the newest ones of the joint.
        """
        if model.load is None or LOAD in samples or "drifting_load" in model.state_names or estimate.status.unusable:
            return estimate
        moved = self._moved.copy()  # samples of a joint that begins to move may come meanwhile, in another thread
        others = tuple(name for name, at in moved.items() if name != joint and at > estimate.start)
        if not others:
            return estimate
        basis = (estimate.notes, others)
        if joint not in self._told or self._told[joint][0] != basis:  # hardly ever: words take longer than to compare
            first, more = estimate.notes[: MOST_SENTENCES - 1], estimate.notes[MOST_SENTENCES - 1 :]
            notes = (*first, TEXT.format(listed(sorted(others))), *more)  # the last one that the message shows
            self._told[joint] = basis, notes, message(notes)
        _, notes, said = self._told[joint]
        return estimate.updated(message=said, notes=notes)
