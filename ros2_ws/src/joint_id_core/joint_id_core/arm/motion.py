"""Positions, velocities and accelerations of all joints of an arm at the instants of one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions, differentiate

# Above it, accelerations are mostly noise: they are the second derivative of an encoder. Friction of a UR10e does not
# depend on it between 5 and 35 Hz.
CUTOFF_HZ = 20.0
BRIDGED_S = 0.02  # gaps up to it are bridged: a sixth of the shortest period that the equations look at
AT_ZERO = 0.02  # rad or m, from 0 of a joint that counts as fixed there
SETTLED_S = 0.1  # at the ends of a stretch derivatives are less accurate, as no samples are beyond


def motion(
    recordings: Mapping[str, Recording], joints: Sequence[str], like: Recording, source: str
) -> tuple[Array, Array, Array]:
    """Return positions, velocities and accelerations, each of shape (T, joints).

    They are NaN in gaps of a joint, and near the ends of what was recorded without a gap.

    Args:
        recordings: of all joints, by name, with their link positions.
        joints: names of those that are wanted.
        like: the recording whose T instants are taken.
        source: of `joints`, for messages.

    Raises:
        JointIdError: a joint was not recorded, or not its link position.
    """
    require_recorded(recordings, joints, source)
    found = [_moved(recordings[name], name, like) for name in joints]
    q, dq, ddq = (np.array(rows).T for rows in zip(*found, strict=True))
    return q, dq, ddq


def require_recorded(recordings: Mapping[str, Recording], joints: Sequence[str], source: str) -> None:
    """Check that all joints of a robot were recorded; `source` is its description.

    Raises:
        JointIdError: one was not, or has no samples.
    """
    missing = [name for name in joints if name not in recordings or len(recordings[name]) < 2]
    if missing:
        there = next((r.source for r in recordings.values()), "the recording")
        raise JointIdError(
            f"{there}: no recording of {', '.join(missing)}, which {source} moves (recorded: "
            f"{', '.join(recordings) or 'none'}): joints are found by name. Record all joints, or make one that stands "
            "still fixed (--still of joint-id, or in a copy of the description)"
        )


def require_still(recordings: Mapping[str, Recording], still: Sequence[str]) -> None:
    """Check that joints which count as fixed at 0 are there in recordings that hold them.

    Raises:
        JointIdError: one is elsewhere.
    """
    for name in still:
        if name in recordings and recordings[name].measured("link_position"):
            at = float(np.nanmedian(recordings[name]["link_position"]))
            if abs(at) > AT_ZERO:
                raise JointIdError(
                    f"{recordings[name].source}: joint {name} is at {at:.3g}, and with --still {name} it counts as "
                    "fixed at 0: leave that out, as it was recorded. That it does not move is found from the recording"
                )


def bridging(options: FilterOptions, period: float) -> FilterOptions:
    """Return options that bridge gaps of `BRIDGED_S`, or of more periods: what a fast recording lost does no harm."""
    return replace(options, max_gap=max(options.max_gap, BRIDGED_S / period))


def _moved(recording: Recording, name: str, like: Recording) -> list[Array]:
    """Return the motion of one joint at the instants of another one."""
    if not recording.measured("link_position"):
        raise JointIdError(
            f"{recording.source}: joint {name} has no link_position: the load of an arm needs all of them"
        )
    options = bridging(FilterOptions(cutoff_hz=CUTOFF_HZ), recording.period).fitting(recording.period)
    rows = differentiate(recording.time, recording["link_position"], options, 2, recording.source)
    known = np.isfinite(rows[2])
    time = recording.time[known] + float(recording.origin - like.origin)
    nothing = np.full(len(like), np.nan)
    if len(time) < 2:
        return [nothing, nothing, nothing]
    far = np.diff(time) > options.max_gap * recording.period
    edges = np.concatenate([time[:1], time[:-1][far], time[1:][far], time[-1:]])
    after = np.searchsorted(edges, like.time)  # odd within a stretch, which begins with an even edge
    nearest = np.minimum(
        np.abs(like.time - edges[np.maximum(after - 1, 0)]),
        np.abs(like.time - edges[np.minimum(after, len(edges) - 1)]),
    )
    settled = (after % 2 == 1) & (nearest > SETTLED_S)
    return [np.where(settled, np.interp(like.time, time, row[known]), np.nan) for row in rows]
