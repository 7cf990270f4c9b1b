"""What equations say of parameters: the quadratic form of what is left of the torques, beside some values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from joint_id_core.data.recording import Array


@dataclass(frozen=True)
class Information:
    """What equations say of the parameters beside some values (P,).

    Attributes:
        matrix, vector, energy: of the quadratic form of what is left of the torques, shapes (P, P), (P,) and ().
    """

    values: Array
    matrix: Array
    vector: Array
    energy: float

    def beside(self, values: Array) -> Information:
        """Return the same beside other values (P,)."""
        step = self.values - values
        vector = self.vector + self.matrix @ step
        return Information(values, self.matrix, vector, self.energy + float(step @ (self.vector + vector)))


def sum_of(parts: Sequence[Information]) -> Information | None:
    """Return what equations say together, beside the same values; None if there are none."""
    if not parts:
        return None
    matrix, vector = (sum((getattr(p, n) for p in parts[1:]), getattr(parts[0], n)) for n in ("matrix", "vector"))
    return Information(parts[0].values, matrix, vector, sum(p.energy for p in parts))
