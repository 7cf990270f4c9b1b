"""How honest fits of real recordings are, where no truth is known: whether those of the same joint agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from robots.cases import Known
from robots.fitted import FRICTION, Fitted, Value

INTERVAL = 1.96  # standard deviations: 95 %


@dataclass(frozen=True)
class Pairs:
    """Pairs of recordings of the same joint: how many agree, of how many."""

    agree: int = 0
    count: int = 0

    def __add__(self, other: Pairs) -> Pairs:
        return Pairs(self.agree + other.agree, self.count + other.count)

    @property
    def share(self) -> float:
        """Repeatability coverage; NaN without a pair."""
        return self.agree / self.count if self.count else float("nan")


def agree(a: Value, b: Value) -> bool:
    """Whether the 95 % interval of the difference contains zero."""
    return abs(a.value - b.value) < INTERVAL * float(np.hypot(a.sigma, b.sigma))


def pairs(fits: Sequence[Fitted], names: Sequence[str] = FRICTION, friction: bool = True) -> Pairs:
    """Pairs of fits of one method that agree, parameter by parameter; `friction`: only of fits that know friction."""
    found = Pairs()
    joints = dict.fromkeys((f.case, f.joint) for f in fits)
    for joint in joints:
        for name in names:
            known = [f.values[name] for f in fits if (f.case, f.joint) == joint and _counts(f, name, friction)]
            found += Pairs(sum(agree(a, b) for a, b in combinations(known, 2)), len(known) * (len(known) - 1) // 2)
    return found


def _counts(fit: Fitted, name: str, friction: bool) -> bool:
    return fit.usable if friction else fit.knows(name)


def usable(fits: Sequence[Fitted]) -> tuple[int, int]:
    """How many fits know friction, of how many."""
    return sum(f.usable for f in fits), len(fits)


def relative_sigma(fits: Sequence[Fitted], names: Sequence[str] = FRICTION) -> float:
    """Median standard deviation over the value, of fits that know friction; NaN without one."""
    found = [f.values[n].sigma / abs(f.values[n].value) for f in fits if f.usable for n in names]
    return float(np.median(found)) if found else float("nan")


def deviation(value: Value, known: Known) -> float:
    """Difference from a reference in combined standard deviations, with its sign."""
    return (value.value - known.value) / float(np.hypot(value.sigma, known.spread))


@dataclass(frozen=True)
class Off:
    """The value that is farthest from its reference.

    Attributes:
        fit, name: which one; None if no value has a reference.
        sigmas: difference in combined standard deviations.
        share: difference over the reference.
    """

    fit: Fitted | None = None
    name: str = ""
    sigmas: float = float("nan")
    share: float = float("nan")


def farthest(
    fits: Sequence[Fitted], known: dict[tuple[str, str], dict[str, Known]], names: Sequence[str], good: bool = False
) -> Off:
    """The value farthest off; `known` is by case and joint. `good`: only of fits that say that all is well.

    Friction counts if the fit knows both parameters, other values if it knows them.
    """
    worst = Off()
    for fit in fits:
        for name, reference in known[fit.case, fit.joint].items():
            if name not in names or (good and not fit.good) or not _counts(fit, name, name in FRICTION):
                continue
            sigmas = deviation(fit.values[name], reference)
            if worst.fit is None or abs(sigmas) > abs(worst.sigmas):
                worst = Off(fit, name, sigmas, fit.values[name].value / reference.value - 1.0)
    return worst


def held_out(fits: Sequence[Fitted]) -> tuple[float, float]:
    """Median and least R2 of held-out drives; NaN without one."""
    found = [r for f in fits for r in f.held_out]
    return (float(np.median(found)), min(found)) if found else (float("nan"), float("nan"))


def times(fits: Sequence[Fitted]) -> tuple[float, float]:
    """Median and longest processor time of a fit in s."""
    found = [f.cpu_s for f in fits]
    return float(np.median(found)), max(found)
