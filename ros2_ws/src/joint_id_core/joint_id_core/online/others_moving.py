"""Other joints of a robot that move at the same time, whose load on a joint nobody knows."""

from __future__ import annotations

from collections.abc import Mapping

from joint_id_core.checking.signals import GOES, known
from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.estimators.shared.sentences import MOST_SENTENCES, listed, message
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

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
        self._moved: dict[str, float] = {}  # newest instant in s at which a joint moved
        self._from: dict[tuple[str, str], float] = {}  # positions from there

    def take(self, recordings: Mapping[str, Recording]) -> None:
        """Take the newest samples of all joints, by name."""
        for joint, recording in recordings.items():
            for channel in (n for n in recording.channels if n.endswith("_position") and recording.measured(n)):
                positions = known(recording[channel])
                if len(positions) and self._goes(joint, channel, positions.min(), positions.max(), positions[-1]):
                    self._moved[joint] = float(recording.time[-1])

    def _goes(self, joint: str, channel: str, lowest: float, highest: float, newest: float) -> bool:
        """Return whether a position went further than that of a joint that is shaken, since it last did."""
        begin = self._from.setdefault((joint, channel), newest)
        if max(highest - begin, begin - lowest) <= GOES["position"] * CHANNELS[channel].scale:
            return False
        self._from[joint, channel] = newest
        return True

    def told(self, joint: str, estimate: Estimate, samples: Recording, model: Model) -> Estimate:
        """Return an estimate that names the joints that moved meanwhile, if their load counts and is not known.

        `samples` are the newest ones of the joint.
        """
        if model.load is None or LOAD in samples or "drifting_load" in model.state_names or estimate.status.unusable:
            return estimate
        others = [name for name, moved in self._moved.items() if name != joint and moved > estimate.start]
        if not others:
            return estimate
        first, more = estimate.notes[: MOST_SENTENCES - 1], estimate.notes[MOST_SENTENCES - 1 :]
        notes = (*first, TEXT.format(listed(sorted(others))), *more)  # the last one that the message shows
        return estimate.updated(message=message(notes), notes=notes)
