"""Motor and link encoders with different zeros."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import moves
from joint_id_core.data.recording import Recording

LARGEST = 0.02  # rad at the link: no gear of a robot twists so far
RATIO = 10.0  # a smaller ratio is no gear with a twist


def twist_offset(recording: Recording) -> Iterator[Finding]:
    """Find a twist between motor and link that is mostly a constant."""
    names = ("motor_position", "link_position")
    if not all(recording.measured(n) for n in names):
        return
    known = np.all([np.isfinite(recording[n]) for n in names], axis=0)
    motor, link = (recording[n][known] for n in names)
    if len(motor) < 3 or not (moves(motor) and moves(link)):
        return
    middle = float(link.mean())
    spread = link - middle
    ratio = float(spread @ motor) / float(spread @ spread)
    if abs(ratio) < RATIO:
        return
    left = motor / ratio - link
    offset = float(left.mean())
    # The ratio is not known better than the twist allows.
    unsure = float(np.std(left)) / float(np.std(spread)) * abs(middle)
    if abs(offset) > LARGEST + 5.0 * unsure:
        yield Finding(
            f"Motor and link angle differ by {offset:.4g} rad throughout, beside the gear ratio of {ratio:.5g}: their "
            "encoders have different zeros; subtract this, or take a model with an offset of the twist (dtheta_0)",
            names,
            about="twist",
        )
