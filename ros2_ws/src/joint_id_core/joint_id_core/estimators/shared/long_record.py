"""The part of a very long recording that a fit takes: its time and memory grow with the number of samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.shared.stillness import still_in_record
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

MOST = 1_000_000  # samples of one fit: half an hour of motion at 500 Hz; about a minute, 2 GB
STRETCHES = 20  # into which they are split, so that they come from all of the motion
REST_S = 1.0  # of each rest that stays beside the motion


def fitted_part(model: Model, recording: Recording) -> Recording:
    """Return what a fit takes of a recording: all, or of more than `MOST` samples stretches of the motion, with gaps.

    The stretches are spread evenly over the samples at which the joint moves, and hold at most `MOST` samples.
    """
    if len(recording) <= MOST:
        return recording
    kept = np.flatnonzero(_near_motion(model, recording))
    if not len(kept):
        return recording.slice(0, MOST)
    if len(kept) > MOST:
        each = MOST // STRETCHES
        firsts = np.linspace(0, len(kept) - each, STRETCHES).astype(np.int64)
        kept = np.concatenate([kept[first : first + each] for first in firsts])
    channels = {name: values[kept] for name, values in recording.channels.items()}
    return recording.trusted(recording.time[kept], channels, recording.derived)


def with_part(estimate: Estimate, part: Recording, recording: Recording) -> Estimate:
    """Return an estimate that says which part of the recording it is of, if that is not all."""
    if len(part) == len(recording):
        return estimate
    said = (
        f"Fitted were {len(part):,} of {len(recording):,} samples, spread over all of the motion: a fit takes no more. "
        "Fit parts of the recording (--start, --end) to see whether the joint changed."
    )
    return replace(estimate, notes=(*estimate.notes, said))


def _near_motion(model: Model, recording: Recording) -> NDArray[np.bool_]:
    """Return True for samples at which the joint moves, or less than `REST_S` from there, shape (T,)."""
    labels = tuple(name for name in model.state_names if recording.measured(name))
    if not labels:
        return np.ones(len(recording), dtype=bool)  # the fit says what is missing
    rest = still_in_record(labels, np.array([recording[n] for n in labels]).T, recording.period)
    around = 2 * round(REST_S / recording.period) + 1
    return np.asarray(maximum_filter1d((~rest).view(np.uint8), around).view(bool))
