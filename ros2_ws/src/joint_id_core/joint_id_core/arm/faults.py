"""What is wrong with the samples of a followed arm: named, and counted in its intervals."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.data.recording import Array


@dataclass(frozen=True)
class Faults:
    """Faults that were found in the motion from which an arm was learnt: see `suspects`.

    Attributes:
        texts: those that are sure, in words.
        shift: what all may do to the parameters of a `Belief`, (P,).
        gross: one of the texts if it is of a fault too large to be what it is called; else empty.
    """

    texts: tuple[str, ...]
    shift: Array
    gross: str = ""
