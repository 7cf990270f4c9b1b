"""Whether noise of sensors of inputs, and no change of the joint, makes new samples disagree with the memory.

Noise that is in the record and moves nothing makes inertia seem larger, the more the less a motion accelerates (see
`online.input_noise`). So slow motion after a fast one looks like a joint that has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.memory import Memory
from joint_id_core.online.noise_effects import attenuation
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

# Of what `attenuation` finds, which takes half of the noise of a drive for that of its sensor: so much, or all.
SHARES = (1.0, 2.0)


def explained_by_noise(
    tracker: Tracker, memory: Memory, pieces: Sequence[Piece], bias: Array, memory_s: float
) -> bool:  # fmt: skip
    """Return whether the test of a memory finds no change once the effect of this noise is taken off.

    Args:
        tracker: passes stretches through the filter again.
        memory: what was known before these stretches, and they themselves.
        pieces: the newest stretches, at values that fit all of them.
        bias: what the noise does to the memory's estimate, shape (k,).
        memory_s: time constant of forgetting.
    """
    if not tracker.shown_noise:
        return False
    rng = np.random.default_rng(0)
    effects = [attenuation(tracker, piece, rng) for piece in pieces]
    before = memory.copy()
    before.replace(pieces, memory_s)
    before.drop(len(pieces))
    for share in SHARES:
        other = before.copy()
        other.shift(-share * other.matrix @ bias)
        for piece, effect in zip(pieces, effects, strict=True):
            other.add(replace(piece, vector=piece.vector - share * effect), memory_s)
        if other.test() is None:
            return True
    return False
