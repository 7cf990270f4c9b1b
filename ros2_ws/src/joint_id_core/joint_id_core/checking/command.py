"""Whether the joint follows the recorded command."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Array, Recording

COMMAND = "reference_position"
FOLLOWS = 0.3  # rms of the distance, apart from a constant, over that of the angle, up to which it does
MISSING = 0.1  # share of the samples without a command up to which it is one


def follows(command: Array, angle: Array) -> bool:
    """Return whether an angle of the link (T,) follows a command (T,)."""
    known = np.isfinite(command) & np.isfinite(angle)
    if np.count_nonzero(known) < (1.0 - MISSING) * len(command):
        return False
    return float(np.std((command - angle)[known])) < FOLLOWS * float(np.std(angle[known]))


def unfollowed(recording: Recording) -> Iterator[Finding]:
    """Find a command that the link does not follow; a joint that is held still has none."""
    names = ("link_position", COMMAND)
    if not all(recording.measured(n) for n in names) or not any(goes(n, recording[n]) for n in names):
        return
    if not follows(recording[COMMAND], recording["link_position"]):
        yield Finding(
            f"The link does not follow {COMMAND}, or it is missing in many samples: check its unit (rad at the link) "
            "and its joint; it is not used",
            names,
            about="command",
        )
