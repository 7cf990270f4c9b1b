"""Motions of several joints, one after the other, as one motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.design.design import Design
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError

EVEN = 1e-6  # share of a period by which those of two motions may differ


def one_after_other(designs: Sequence[Design]) -> Design:
    """Return motions as one: each joint makes its own while the others stand.

    Nothing else moves then, so what each motion promises holds as it does alone. Notes that not all of them have begin
    with the joint.

    Args:
        designs: at least one, each of a single joint, sampled at the same rate.

    Raises:
        JointIdError: several joints in one motion, a joint twice, other rates.
    """
    motions = [design.trajectory for design in designs]
    names, period = tuple(name for motion in motions for name in motion.names), motions[0].period
    for motion in motions:
        if len(motion.names) > 1 or abs(motion.period - period) > EVEN * period:
            raise JointIdError(
                f"the motion of {', '.join(motion.names)}: give one joint a motion, all at the same rate"
            )
    columns = [[np.zeros((0, len(motions)))] * 3]
    stand = np.array([motion.position[0, 0] for motion in motions])
    for k, motion in enumerate(motions):
        rows = slice(1 if k else 0, None)  # a motion begins at the instant at which the one before it ends
        part = [np.tile(values, (len(motion.time[rows]), 1)) for values in (stand, 0.0 * stand, 0.0 * stand)]
        for values, own in zip(part, (motion.position, motion.velocity, motion.acceleration), strict=True):
            values[:, k] = own[rows, 0]
        stand[k] = motion.position[-1, 0]
        columns.append(part)
    position, velocity, acceleration = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    time = np.asarray(np.arange(len(position)) * period, dtype=float)
    common = [note for note in designs[0].notes if all(note in design.notes for design in designs)]
    own_notes = [
        f"{name}: {note}"
        for name, design in zip(names, designs, strict=True)
        for note in design.notes
        if note not in common
    ]
    return Design(
        Trajectory(names, time, position, velocity, acceleration),
        tuple(row for design in designs for row in design.expected),
        (*own_notes, *common),
    )
