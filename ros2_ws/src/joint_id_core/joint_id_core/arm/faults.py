"""What is wrong with the samples of a followed arm: named, and counted in its intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations
from joint_id_core.arm.tested_faults import MEANWHILE, tested_faults
from joint_id_core.data.recording import Array


@dataclass(frozen=True)
class Faults:
    """Faults that were found in the motion from which an arm was learnt: see `suspects`.

    Attributes:
        texts: those that are sure, in words.
        shift: what all may do to the parameters of a `Belief`, (P,).
        amounts: of all, by the name of the fault.
        gross: one of the texts if it is of a fault too large to be what it is called; else empty.
    """

    texts: tuple[str, ...]
    shift: Array
    gross: str = ""
    amounts: Mapping[str, float] = field(default_factory=dict)

    def torque(self, description: Description, part: Equations, values: Array, carries: bool) -> Array:
        """Return the torque in Nm that they add to each joint in a later stretch of motion, (R, n).

        Args:
            description: of the arm.
            part: the stretch.
            values: of the parameters of a `Belief`, (P,); those of the payload count if the arm `carries` it.
        """
        later = f"load {MEANWHILE}"  # it stays as it was in the second half of the motion from which the arm was learnt
        found = self.amounts.get(later, 0.0) * part.columns[:, :, part.base]
        for fault in tested_faults(description, [replace(part, loaded=carries)], values):
            if fault.name != later and fault.name in self.amounts:
                found = found + self.amounts[fault.name] * fault.torque[0]
        return np.nan_to_num(found)
