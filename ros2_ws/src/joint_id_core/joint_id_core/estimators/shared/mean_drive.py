"""A drive that changes between two samples, in place of one that is held.

The cell holds the drive from one sample to the next, as a controller does. A recording with fewer samples than the
controller made, as a topic that passes on every fourth one, shows a drive that changed in between. Held, it comes up to
half a sample late, which looks like viscous friction: c was 9 % too large in every second sample of a simulated joint,
and 35 % in every fourth.

What is held in its place is its mean over the step. Of n samples of the controller in a step, the first is known, and
those that follow lie between it and the next one that is known: the next one has the share (n - 1) / 2n of the mean, a
half if the drive changes all the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import Model

CHANGES = "changes between two samples"  # in what is said of it
MOST = 0.5  # share of the next sample of a drive that changes all the time
LEAST = 0.02  # the same, below which a drive is held; of every second sample of a controller it is a fourth
SELDOM = 0.1  # of recordings that have fewer samples than the controller made, before anything is known of this one
SHARES = 501  # that are compared
NEXT = 1.5  # periods up to which two samples follow each other
# Weights, of the two samples of a step and of the two beside them, of the mean of the cubic through all four. With it
# velocities are right at every sample. Positions are off by u T^2/12 over the inertia, as within a step it matters when
# the drive acted. Where a simulation is compared with positions alone, the second derivative of that is taken off.
VELOCITY, POSITION = (13.0 / 24.0, -1.0 / 24.0), (7.0 / 12.0, -1.0 / 12.0)


def with_mean_drive(
    model: Model, recording: Recording, share: float, weights: tuple[float, float] = VELOCITY
) -> Recording:
    """Return a recording with the mean drive over each step, of which the next sample has a `share` up to `MOST`.

    Over a gap, and before a missing value, the drive is held. `weights` are `VELOCITY` or `POSITION`.
    """
    assert model.drive is not None
    drive = recording[model.drive]
    follows = _follows(recording, recording.time, drive)
    mean = drive.copy()
    mean[:-1] = np.where(follows, 0.5 * (drive[:-1] + drive[1:]), drive[:-1])
    inner = follows[:-2] & follows[1:-1] & follows[2:]
    near, far = weights
    cubic = near * (drive[1:-2] + drive[2:-1]) + far * (drive[:-3] + drive[3:])
    mean[1:-2] = np.where(inner, cubic, mean[1:-2])
    return recording.with_channels({model.drive: drive + share / MOST * (mean - drive)})


def slope(recording: Recording, time: Array, drive: Array) -> Array:
    """Return by how much a drive (T,) changes in a sample, from its neighbours, shape (T,); 0 beside a gap.

    With a share of it, the drive comes that much of a sample earlier. Noise of its sensor is not averaged, as it is by
    a mean: only a drive that comes too late gets better.
    """
    follows = _follows(recording, time, drive)
    found = np.zeros_like(drive)
    found[1:-1] = np.where(follows[1:] & follows[:-1], 0.5 * (drive[2:] - drive[:-2]), 0.0)
    return found


def _follows(recording: Recording, time: Array, drive: Array) -> NDArray[np.bool_]:
    """Return whether each sample and the one that follows at once are known, shape (T - 1,)."""
    known = np.isfinite(drive)
    return np.asarray((np.diff(time) < NEXT * recording.period) & known[1:] & known[:-1])


def mean_square_share(share: float, information: float) -> float:
    """Return the mean square of the share of the next sample, of which a value and its information are known.

    It is 0 unless the recording is one of those that are `SELDOM`. In these any share up to `MOST` is as likely as
    another one.
    """
    shares = np.linspace(0.0, MOST, SHARES)
    more = information * shares * (share - 0.5 * shares)  # logarithm of the likelihood, over that of a held drive
    odds = np.exp(more - more.max()) * SELDOM / SHARES
    return float(odds @ shares**2 / (odds.sum() + np.exp(-more.max()) * (1.0 - SELDOM)))


def changes(model: Model, share: float) -> str:
    """Return in words that the drive was not held."""
    return (
        f"{model.drive} {CHANGES}, as if the controller had made more of them than were recorded: its mean over each "
        f"step is taken, with a share of {share:.2g} of the next sample"
    )
