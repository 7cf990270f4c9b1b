"""A designed motion, with what it will tell of each parameter."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from joint_id_core.design.trajectory import Trajectory
from joint_id_core.results.verdict import MAGNITUDE, Verdict


@dataclass(frozen=True)
class Expected:
    """What a motion is expected to tell of one parameter, in SI units.

    Attributes:
        joint: that it belongs to; "" for one of the whole arm.
        name, unit: of the parameter.
        value: that is taken for it.
        std_dev: that a fit of the motion will give; NaN where the motion does not show it.
        verdict: that a fit will give.
        reason: why the motion does not show it, and what would.
    """

    joint: str
    name: str
    unit: str
    value: float
    std_dev: float
    verdict: Verdict
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Design:
    """A motion and its promise. `print` shows it as a table.

    Attributes:
        trajectory: the motion.
        expected: one row for each parameter.
        notes: as sentences: what was assumed, what the user must check before the robot moves.
    """

    trajectory: Trajectory
    expected: tuple[Expected, ...]
    notes: tuple[str, ...] = ()

    @property
    def shown(self) -> tuple[Expected, ...]:
        """The parameters that the motion will show."""
        return tuple(row for row in self.expected if row.verdict is Verdict.ESTIMATED)

    def to_dict(self) -> dict[str, Any]:
        """Return the promise as plain JSON types, without the samples of the motion."""
        motion = self.trajectory
        return {
            "joints": list(motion.names), "duration_s": motion.duration, "rate_hz": motion.rate,
            "parameters": [{**asdict(row), "verdict": row.verdict.value} for row in self.expected],
            "notes": list(self.notes),
        }  # fmt: skip

    def __str__(self) -> str:
        """Return the promise as lines of text."""
        motion, asked = self.trajectory, sum(row.verdict is not Verdict.FIXED for row in self.expected)
        lines = [
            f"motion of {', '.join(motion.names)}: {motion.duration:g} s, {motion.rate:g} samples a second",
            f"  {len(self.shown)} of {asked} parameters will be estimated",
            "",
        ]
        width = max([11, *(len(row.unit) + 1 for row in self.expected)])
        name = max([10, *(len(_name(row)) + 1 for row in self.expected)])
        head = f"  {'parameter':<{name}}{'value':>11}  {'std dev':>10}  {'':>9}  {'unit':<{width}}verdict to expect"
        lines += [head, *(_row(row, name, width) for row in self.expected)]
        if reasons := [f"  {_name(row)}: {row.reason}" for row in self.expected if row.reason]:
            lines += ["", *reasons]
        return "\n".join([*lines, *(["", *(f"  {note}" for note in self.notes)] if self.notes else [])])


def verdict_of(value: float, std_dev: float) -> Verdict:
    """Return what a fit without a prior will say of a parameter with this value and standard deviation."""
    known = math.isfinite(std_dev) and std_dev <= MAGNITUDE * abs(value)
    return Verdict.ESTIMATED if known else Verdict.NOT_EXCITED


def _name(row: Expected) -> str:
    return f"{row.joint}.{row.name}" if row.joint else row.name


def _row(row: Expected, name: int, width: int) -> str:
    known = math.isfinite(row.std_dev)
    share = f"({100.0 * row.std_dev / abs(row.value):.2g} %)" if known and row.value else ""
    deviation = f"{row.std_dev:.2g}" if known else ""
    return (
        f"  {_name(row):<{name}}{row.value:>11.4g}  {deviation:>10}  {share:>9}  {row.unit:<{width}}{row.verdict.value}"
    )
