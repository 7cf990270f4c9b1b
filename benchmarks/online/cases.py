"""What happens to a joint while it is watched.

A case changes parameters of the simulated joint, or what its sensors show, once the joint has been watched for a while.
A torque constant is not estimated by the models that are driven by a current: what they can find is every torque and
inertia in units of the drive, so all of these must grow by 1 / 0.95. A fault of a sensor changes no parameter, except
that the models with a torque offset `tau_0` must find the offset of the current there. The question is then whether the
fault is said, or the intervals still hold the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

DRIFT_S = 300.0  # length of a slow drift: five times the memory of the identifier


@dataclass(frozen=True)
class Case:
    """One thing that happens.

    Attributes:
        name: as in the table.
        part: of the joint whose parameters change: load, friction, stiffness or drive.
        factor: of these parameters; with `drift` after an hour.
        drift: whether they change slowly and all the time.
        fault: of a sensor: frozen, late or offset.
    """

    name: str
    part: str = ""
    factor: float = 1.0
    drift: bool = False
    fault: str = ""

    @property
    def after_s(self) -> Mapping[str, float]:
        """How long the joint is watched afterwards in s, by motion."""
        return dict.fromkeys(AFTER_S, DRIFT_S) if self.drift else AFTER_S


# Seconds of motion before the change, and after it. Ordinary motion shows less of the joint in the same time.
BEFORE_S = {"excited": 12.0, "ordinary": 20.0}
AFTER_S = {"excited": 16.0, "ordinary": 30.0}
MOTIONS = tuple(BEFORE_S)

CASES = (
    Case("nothing"),
    Case("load × 0.5", "load", 0.5),
    Case("load × 2", "load", 2.0),
    Case("load + 10 %", "load", 1.1),
    *(Case(f"friction {100 * (f - 1):+.0f} %", "friction", f) for f in (1.05, 0.95, 1.2, 0.8, 1.5, 0.5)),
    Case("stiffness -10 %", "stiffness", 0.9),
    Case("stiffness -50 %", "stiffness", 0.5),
    Case("torque constant -5 %", "drive", 0.95),
    Case("friction +10 % an hour", "friction", 1.1, drift=True),
    Case("friction +60 % an hour", "friction", 1.6, drift=True),
    Case("current offset 0.05 A", fault="offset"),
    Case("encoder frozen", fault="frozen"),
    Case("encoder late by 5 ms", fault="late"),
)
