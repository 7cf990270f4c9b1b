"""The part of a recording with the most motion, which tells soon that a model does not describe it."""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare
from joint_id_core.estimators.shared.initial_state import busiest
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model

# Parts of a recording of which one is tried, and samples of it at least. On logs of a UR3e and a UR10e, 13 joints, the
# flexible joint did not describe whole logs where it did not describe so little of them, in a fifth of the time.
PARTS, LEAST = 4, 1000


def excerpt(model: Model, recording: Recording, settings: ParameterSettings) -> Recording | None:
    """Return the part with the most motion; None of a recording that is too short, or that cannot be fitted."""
    length = max(LEAST, len(recording) // PARTS)
    if len(recording) < PARTS * LEAST:
        return None
    try:
        data = prepare(model, recording, settings, leave_out_rests=True)
    except UnusableError:
        return None
    if len(data.time) <= length:
        return None
    first = busiest(data, length)
    begin, end = recording.time.searchsorted(data.time[[first, first + length - 1]])
    return recording.slice(int(begin), int(end) + 1)
