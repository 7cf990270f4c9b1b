"""How the parameters of joints went over many saved estimates."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from joint_id_core.data.quantities import change_text, with_deviation
from joint_id_core.data.recording import Array
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import Verdict

DAY_S = 86400.0
SURE = 3.0  # standard deviations of a slope from which it is a trend
FEWEST = 3  # estimates that a trend needs
EARLIEST_S = 1e8  # since 1970: an instant before is the time of a recording that begins at zero


class Known(NamedTuple):
    """One parameter of a joint, from one recording; `instant_s` since 1970 where the recording had such stamps."""

    robot: str
    joint: str
    model: str
    name: str
    unit: str
    instant_s: float
    value: float
    std_dev: float


@dataclass(frozen=True)
class Course:
    """One parameter of a joint over estimates, in the order of their time; without that in the order of the files.

    Attributes:
        robot: name of the robot, "" where it is not known; label: of the joint, with the model if it has several.
        days: since the first one, shape (n,), NaN if one of the recordings has no date.
        values, std_devs: in `unit`, shape (n,).
        slope, slope_std_dev: of a weighted straight line, in `unit` a day, without dates in `unit` a file; NaN if a
            line says nothing. The standard deviation follows from those of the values, or from their scatter (with the
            quantile of Student's t) where that is wider.
    """

    joint: str
    name: str
    unit: str
    days: Array
    values: Array
    std_devs: Array
    slope: float
    slope_std_dev: float
    robot: str = ""
    model: str = ""
    label: str = ""

    @property
    def dated(self) -> bool:
        """Whether it is known when each estimate was made."""
        return bool(np.isfinite(self.days).all())

    @property
    def trend(self) -> str:
        """The verdict in words."""
        if math.isnan(self.slope):
            return f"fewer than {FEWEST} estimates" + (" at different times" if self.dated else "")
        weights = self.std_devs**-2
        mean = abs(float(np.average(self.values, weights=weights)))
        # of what may be zero, such as an offset, a share says nothing
        share, unit = (100.0 / mean, "%") if mean > SURE / math.sqrt(float(weights.sum())) else (1.0, self.unit)
        sigmas = abs(self.slope) / self.slope_std_dev
        each = "day" if self.dated else "file"
        change = change_text(share * self.slope, share * self.slope_std_dev, unit)
        size = f"{change} a {each}, {sigmas:.1f} sigma"
        return f"{size}: {'a trend' if sigmas > SURE else f'no trend beyond {SURE:g} sigma'}"


def known(estimates: Iterable[Estimate]) -> list[Known]:
    """Return what estimates know of their joints.

    Estimates that did not converge, and values that are not called estimated, are left out.
    """
    return [
        Known("", e.joint or "joint", e.model, p.name, p.unit, _instant(e), p.value, p.std_dev)
        for e in estimates
        if e.converged
        for p in e.parameters
        if p.verdict is Verdict.ESTIMATED and p.std_dev > 0.0
    ]


def courses(rows: Sequence[Known]) -> list[Course]:
    """Return the course of every parameter, robot by robot and joint by joint.

    Those of one joint must be of one model: others are other parameters of the same name, and become a course of their
    own.
    """
    kept: dict[tuple[str, str, str, str], list[tuple[float, float, float]]] = {}
    units: dict[str, str] = {}
    for r in rows:
        units[r.name] = r.unit
        kept.setdefault((r.robot, r.joint, r.model, r.name), []).append((r.instant_s, r.value, r.std_dev))
    models = {(robot, joint, model) for robot, joint, model, _ in kept}
    several = Counter((robot, joint) for robot, joint, _ in models)
    found = []
    for (robot, joint, model, name), values_at in kept.items():
        label = f"{joint} ({model})" if several[robot, joint] > 1 else joint
        dated = all(seconds > EARLIEST_S for seconds, _, _ in values_at)
        ordered = sorted(values_at, key=lambda at: at[0] if dated else 0.0)  # equal ones keep their order
        seconds, values, sigmas = np.array(ordered).T
        days = (seconds - seconds[0]) / DAY_S if dated else np.full(len(seconds), np.nan)
        line = _line(days if dated else np.arange(len(days), dtype=float), values, sigmas)
        found.append(Course(joint, name, units[name], days, values, sigmas, *line, robot, model, label))
    return found


def _instant(estimate: Estimate) -> float:
    """Return the end of the data of an estimate in s."""
    return estimate.origin + (estimate.end if math.isfinite(estimate.end) else 0.0)


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
    names = [f"{c.robot} {c.label}".strip() for c in found]
    width = max([6, *map(len, names)]) + 2
    lines = [f"  {'joint':<{width}}{'parameter':<10}{'n':>3}{'first':>23}{'last':>23}  {'unit':<11}trend"]
    for c, name in zip(found, names, strict=True):
        first, last = (with_deviation(float(c.values[k]), float(c.std_devs[k])) for k in (0, -1))
        lines.append(f"  {name:<{width}}{c.name:<10}{len(c.days):>3}{first:>23}{last:>23}  {c.unit:<11}{c.trend}")
    if not all(c.dated for c in found):
        lines.append("recordings without dates: their estimates are taken in the order of the files")
    return "\n".join(lines)
