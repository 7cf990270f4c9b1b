"""What changed between two estimates of a joint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from joint_id_core.data.quantities import change_text, with_deviation
from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate, ParameterEstimate
from joint_id_core.results.verdict import Verdict

SURE = 3.0  # standard deviations of the difference from which a parameter has changed


@dataclass(frozen=True)
class Difference:
    """One parameter in two estimates; the earlier one first.

    `reason` says why the two are not compared; empty if they are.
    """

    before: ParameterEstimate
    after: ParameterEstimate
    reason: str = ""

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.before.name

    @property
    def change(self) -> float:
        """Value after minus value before."""
        return self.after.value - self.before.value

    @property
    def std_dev(self) -> float:
        """Standard deviation of the change, of two independent estimates."""
        return math.hypot(self.before.std_dev, self.after.std_dev)

    @property
    def sigmas(self) -> float:
        """The change in standard deviations; NaN if the two are not compared."""
        return math.nan if self.reason else self.change / self.std_dev

    @property
    def changed(self) -> bool:
        """Whether the parameter has changed, beyond chance."""
        return abs(self.sigmas) > SURE

    @property
    def text(self) -> str:
        """The verdict in words: "+12.0 ± 2.0 %, 6.0 sigma: changed"."""
        if self.reason:
            return self.reason
        before = self.before
        # of what may have been zero, such as an offset, a share says nothing
        if abs(before.value) > SURE * before.std_dev:
            share = 100.0 / abs(before.value)
            size = change_text(share * self.change, share * self.std_dev, "%")
        else:
            size = change_text(self.change, self.std_dev, before.unit)
        said = "changed" if self.changed else f"no change beyond {SURE:g} sigma"
        return f"{size}, {abs(self.sigmas):.1f} sigma: {said}"


def differences(before: Estimate, after: Estimate) -> list[Difference]:
    """Return what two estimates say of each parameter that at least one of them estimates.

    Parameters are compared where both are called estimated, as independent: of recordings that share no samples.

    Raises:
        JointIdError: other joints, models or options, or another held value, which would change all others; the same
            estimate twice.
    """
    if before.joint and after.joint and before.joint != after.joint:
        raise JointIdError(
            f"one estimate is of joint {before.joint}, the other of joint {after.joint}: give two of the same joint"
        )
    for what, one, other in (
        ("models", before.model, after.model),
        ("options of the model", dict(before.model_options), dict(after.model_options)),
    ):
        if one != other:
            raise JointIdError(f"the estimates have other {what}, {one} and {other}: fit both recordings alike")
    found = []
    for row in before.parameters:
        later, held = after[row.name], row.name not in before.free
        if held != (row.name not in after.free) or (held and not math.isclose(row.value, later.value, rel_tol=1e-9)):
            raise JointIdError(
                f"{row.name} is {_held(before, row)} in one estimate and {_held(after, later)} in the other: fit both "
                "alike"
            )
        if not held:
            found.append(Difference(row, later, _unknown(row, later)))
    if found and _same(before, after):
        raise JointIdError("both are the same estimate, or of the same recording: give one of another recording")
    return found


def _same(before: Estimate, after: Estimate) -> bool:
    """Return whether two estimates say the same to the last digit, as no two recordings do."""
    values = np.array_equal([before[n].value for n in before.free], [after[n].value for n in before.free])
    return values and np.array_equal(before.covariance, after.covariance, equal_nan=True)


def _held(estimate: Estimate, row: ParameterEstimate) -> str:
    return "estimated" if row.name in estimate.free else f"held at {row.value:g}"


def _unknown(before: ParameterEstimate, after: ParameterEstimate) -> str:
    unknown = [w for w, row in (("before", before), ("after", after)) if row.verdict is not Verdict.ESTIMATED]
    return f"not known {' and '.join(unknown)}" if unknown else ""


def table(rows: list[Difference]) -> str:
    """Return the differences as lines of text."""
    lines = [f"  {'parameter':<10}{'before':>22}{'after':>22}  {'unit':<11}change"]
    for row in rows:
        one, other = (with_deviation(p.value, p.std_dev) for p in (row.before, row.after))
        lines.append(f"  {row.name:<10}{one:>22}{other:>22}  {row.before.unit:<11}{row.text}")
    return "\n".join(lines)


def as_dicts(rows: list[Difference]) -> list[dict[str, Any]]:
    """Return the differences as plain JSON types."""
    return [
        {
            "name": row.name, "unit": row.before.unit, "before": row.before.value, "after": row.after.value,
            "change": row.change, "std_dev": row.std_dev, "sigmas": row.sigmas, "changed": row.changed,
            "reason": row.reason,
        }
        for row in rows
    ]  # fmt: skip
