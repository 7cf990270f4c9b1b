"""How the parameters of joints went over many saved estimates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from joint_id_core.data.recording import Array
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import Verdict

DAY_S = 86400.0
SURE = 3.0  # standard deviations of a slope from which it is a trend
FEWEST = 3  # estimates that a trend needs


@dataclass(frozen=True)
class Course:
    """One parameter of a joint over estimates, in the order of their time.

    Attributes:
        days: since the first one, shape (n,).
        values, std_devs: in `unit`, shape (n,).
        slope, slope_std_dev: of a weighted straight line, in `unit` a day; NaN if a line says nothing. The standard
            deviation follows from those of the values, or from their scatter (with the quantile of Student's t) where
            that is wider.
    """

    joint: str
    name: str
    unit: str
    days: Array
    values: Array
    std_devs: Array
    slope: float
    slope_std_dev: float

    @property
    def trend(self) -> str:
        """The verdict in words."""
        if math.isnan(self.slope):
            return f"fewer than {FEWEST} estimates at different times"
        mean = abs(float(np.average(self.values, weights=self.std_devs**-2)))
        share = 100.0 / mean if mean else math.inf
        sigmas = abs(self.slope) / self.slope_std_dev
        size = f"{share * self.slope:+.2g} % ± {share * self.slope_std_dev:.2g} % a day, {sigmas:.1f} sigma"
        return f"{size}: {'a trend' if sigmas > SURE else f'no trend beyond {SURE:g} sigma'}"


def courses(estimates: Sequence[Estimate]) -> list[Course]:
    """Return the course of every parameter that at least one converged estimate knows, joint by joint.

    Estimates that did not converge, and values that are not called estimated, are left out. Those of one joint must be
    of one model: others are other parameters of the same name, and become a course of their own.
    """
    kept: dict[tuple[str, str, str], list[tuple[float, float, float]]] = {}
    units: dict[str, str] = {}
    for e in estimates:
        for p in e.parameters if e.converged else ():
            if p.verdict is Verdict.ESTIMATED and p.std_dev > 0.0:
                units[p.name] = p.unit
                kept.setdefault((e.joint or "joint", e.model, p.name), []).append((_instant(e), p.value, p.std_dev))
    models = {(joint, model) for joint, model, _ in kept}
    found = []
    for (joint, model, name), rows in kept.items():
        label = f"{joint} ({model})" if sum(j == joint for j, _ in models) > 1 else joint
        seconds, values, sigmas = np.array(sorted(rows)).T
        days = (seconds - seconds[0]) / DAY_S
        found.append(Course(label, name, units[name], days, values, sigmas, *_line(days, values, sigmas)))
    return found


def _instant(estimate: Estimate) -> float:
    """Return the end of the data of an estimate in s; it is since 1970 where the recording had such stamps."""
    return 1e-9 * estimate.origin + (estimate.end if math.isfinite(estimate.end) else 0.0)


def _line(days: Array, values: Array, sigmas: Array) -> tuple[float, float]:
    """Return slope and standard deviation of a weighted line; NaN for too few instants."""
    if len(np.unique(days)) < FEWEST:
        return math.nan, math.nan
    weights = sigmas**-2
    middle = np.average(days, weights=weights)
    spread = float(np.sum(weights * (days - middle) ** 2))
    level = np.average(values, weights=weights)
    slope = float(np.sum(weights * (days - middle) * (values - level))) / spread
    left = values - level - slope * (days - middle)
    scatter = math.sqrt(float(np.sum(weights * left**2)) / (len(days) - 2))
    few = float(scipy.stats.t.isf(scipy.stats.norm.sf(SURE), len(days) - 2)) / SURE  # a scatter from few is not known
    return slope, max(1.0, few * scatter) / math.sqrt(spread)


def table(found: Sequence[Course]) -> str:
    """Return the courses as lines of text."""
    width = max([6, *(len(c.joint) for c in found)]) + 2
    lines = [f"  {'joint':<{width}}{'parameter':<10}{'n':>3}{'first':>20}{'last':>20}  {'unit':<11}trend"]
    for c in found:
        first, last = (f"{c.values[k]:.4g} ± {c.std_devs[k]:.2g}" for k in (0, -1))
        lines.append(f"  {c.joint:<{width}}{c.name:<10}{len(c.days):>3}{first:>20}{last:>20}  {c.unit:<11}{c.trend}")
    return "\n".join(lines)
