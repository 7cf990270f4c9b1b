"""Whether parameters have left a baseline, an estimate of an earlier day.

The online estimate is an average over motion whose weights fall exponentially with the time constant `memory_s`. For a
joint that does not change, its error is a stationary process with the standard deviation of the estimate and the
correlation exp(-t / memory_s). So the estimates plotted against limits are a control chart of the EWMA kind (Roberts
1959; Lucas & Saccucci, Technometrics 32, 1990), whose run lengths are known. Nothing is summed up over estimates, as a
CUSUM would: they share their samples, which a sum would count many times, and they share the baseline, whose error does
not average out. Abrupt changes are found by the memory itself, which then forgets what it knew (`online.memory`).

With d the difference from the baseline, s its standard deviation, estimate and baseline together, and t the tolerance,
a parameter has drifted when |d| > t + h s for some time of motion. It is back when |d| <= t. So a parameter that stays
within the tolerance is reported as rarely as the threshold h says, however small s is. The time is for the estimates:
after a change that was none, or a restart, they can be far off for seconds until more motion has corrected them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

from joint_id_core.assignments import numbers_by_name
from joint_id_core.data.quantities import unit_text
from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Verdict

SURE = 0.9999  # confidence above which no more digits are told
SAME = 1e-9  # relative difference of held values that counts as none
PER_KELVIN = "drift_per_kelvin"


@dataclass(frozen=True)
class DriftOptions:
    """Options of the drift monitor.

    Raises:
        JointIdError: a value out of range, or a slope that is not of the form NAME=NUMBER.
    """

    drift_tolerance: float = option(
        0.05, "change of a parameter, relative to its baseline, up to which nothing is reported", lower=0.0, upper=10.0
    )
    drift_threshold: float = option(
        5.0, "standard deviations beyond the tolerance from which a parameter is reported", lower=1.0, upper=100.0
    )
    drift_confirm_s: float = option(
        30.0, "time of motion over which every estimate must be so far off before that is reported", "s",
        lower=0.0, upper=1e6,
    )  # fmt: skip
    drift_per_kelvin: tuple[str, ...] = option(
        (), 'known relative change of a parameter per kelvin, as "NAME=SLOPE"; such a change is no drift'
    )

    def __post_init__(self) -> None:
        check(self)
        for name, slope in self.slopes.items():
            if not math.isfinite(slope):
                raise JointIdError(f"parameter {PER_KELVIN}: the slope of {name} is {slope}: give a finite number")

    @property
    def slopes(self) -> dict[str, float]:
        """Relative change per kelvin by parameter."""
        return numbers_by_name(self.drift_per_kelvin, f"parameter {PER_KELVIN}")


@dataclass
class _Away:
    """A parameter outside of the tolerance: since when in s, whether above, and for how long it was far off in s."""

    since: float
    above: bool
    far_s: float = -1.0  # below zero: the newest estimate was not far off


@dataclass(frozen=True)
class Drift:
    """A parameter that has left its baseline, SI units.

    Attributes:
        name, unit: of the parameter.
        baseline: its baseline, at the present temperature if its slope was given.
        value: the newest estimate.
        std_dev: standard deviation of the difference of the two.
        confidence: probability with which a parameter at the edge of the tolerance would not have been so far off.
        since: end of the first estimate, of all that followed each other outside of the tolerance, in s on the clock of
            the estimates; until: end of the newest one.
        warmer: mean temperature of the newest estimate minus that of the baseline in K; NaN if not known.
    """

    name: str
    unit: str
    baseline: float
    value: float
    std_dev: float
    confidence: float
    since: float
    until: float
    warmer: float

    @property
    def change(self) -> float:
        """Estimate minus baseline."""
        return self.value - self.baseline

    @property
    def text(self) -> str:
        """The drift in words."""
        size, side = abs(self.change), "above" if self.change > 0.0 else "below"
        if size < 10.0 * abs(self.baseline):
            scale = 100.0 / abs(self.baseline)
            by = f"{size * scale:.3g} ± {self.std_dev * scale:.2g} %"
        else:  # the baseline is nearly zero
            by = f"{size:.3g} ± {self.std_dev:.2g} {unit_text(self.unit)}".rstrip()
        sure = f"above {SURE}" if self.confidence > SURE else f"{self.confidence:.4f}"
        text = f"{self.name} is {by} {side} its baseline, confidence {sure}"
        if self.until > self.since:
            text += f", for {self.until - self.since:.0f} s"
        if abs(self.warmer) >= 1.0:  # false for NaN
            text += f", the joint is {abs(self.warmer):.0f} K {'warmer' if self.warmer > 0.0 else 'colder'}"
        return text


class DriftMonitor:
    """Compares the estimates of one joint with its baseline.

    Only parameters that both estimates call `estimated` are compared. An estimate that is not `converged`, or a
    parameter that is not `estimated`, is no evidence: what was found before stays.

    Args:
        baseline: a converged estimate.
        options: tolerance, threshold, slopes.

    Raises:
        JointIdError: the baseline has not converged or determines no parameter; a slope of an unknown parameter, or of
            a joint whose temperature at the baseline is not known.
    """

    def __init__(self, baseline: Estimate, options: DriftOptions | None = None) -> None:
        if not baseline.converged:
            raise JointIdError(f"this estimate cannot be a baseline: {baseline.message}")
        self.baseline, self.options = baseline, options or DriftOptions()
        self._rows = {row.name: row for row in baseline.parameters if _known(row)}
        if not self._rows:
            raise JointIdError("this estimate cannot be a baseline: it determines no parameter")
        self._slopes = self.options.slopes
        for name in self._slopes:
            baseline[name]  # raises an error that names the parameters of the model
        if self._slopes and math.isnan(baseline.temperature):
            raise JointIdError(
                "the temperature at the baseline is not known: publish the temperature of the joint, or leave "
                f"{PER_KELVIN} empty"
            )
        self._away: dict[str, _Away] = {}
        self._newest = math.nan  # end of the newest estimate, if it was evidence
        self._drifts: dict[str, Drift] = {}

    def update(self, estimate: Estimate) -> tuple[Drift, ...]:
        """Take a newer estimate, and return the parameters that have left the baseline, in the order of the model.

        Raises:
            JointIdError: the estimate is of another model, or other parameters or values are held.
        """
        before, self._newest = self._newest, estimate.end if estimate.converged else math.nan
        if estimate.converged:
            self._check(estimate)
            passed = 0.0 if math.isnan(before) else estimate.end - before  # rests do not count
            now = {row.name: row for row in estimate.parameters if _known(row)}
            for name, row in self._rows.items():
                if name in now:
                    self._compare(row, now[name], estimate, passed)
        return tuple(self._drifts[name] for name in self._rows if name in self._drifts)

    def _compare(self, was: ParameterEstimate, now: ParameterEstimate, estimate: Estimate, passed: float) -> None:
        name, warmer = now.name, estimate.temperature - self.baseline.temperature
        factor = 1.0
        if name in self._slopes:
            if math.isnan(warmer):
                return  # no evidence
            factor = math.exp(self._slopes[name] * warmer)
        baseline, change = factor * was.value, now.value - factor * was.value
        beyond = abs(change) - self.options.drift_tolerance * abs(baseline)
        away = self._away.get(name)
        if beyond <= 0.0 or (away is not None and away.above != (change > 0.0)):
            away = None
            self._away.pop(name, None)
            self._drifts.pop(name, None)
        if beyond <= 0.0:
            return
        away = self._away.setdefault(name, away or _Away(estimate.end, change > 0.0))
        std_dev = math.hypot(now.std_dev, factor * was.std_dev)
        if beyond > self.options.drift_threshold * std_dev:
            away.far_s = 0.0 if away.far_s < 0.0 else away.far_s + passed
        else:
            away.far_s = -1.0
        if name in self._drifts or away.far_s >= self.options.drift_confirm_s:
            confidence = NormalDist().cdf(beyond / std_dev)
            self._drifts[name] = Drift(
                name, now.unit, baseline, now.value, std_dev, confidence, away.since, estimate.end, warmer
            )

    def _check(self, estimate: Estimate) -> None:
        """Check that the values of two estimates can be compared."""
        was, advice = self.baseline, "set a new baseline"
        if (estimate.model, dict(estimate.model_options)) != (was.model, dict(was.model_options)):
            raise JointIdError(
                f"the baseline is of model {_described(was)}, the estimates are of {_described(estimate)}: {advice}"
            )
        held, held_then = (
            {r.name: r.value for r in e.parameters if r.verdict is Verdict.FIXED} for e in (estimate, was)
        )
        for name in sorted(held.keys() ^ held_then.keys()):
            how = (
                "estimated in the baseline and is held now" if name in held else "held in the baseline and is free now"
            )
            raise JointIdError(f"{name} was {how}, which also changes the other parameters: {advice}")
        for name, value in held.items():
            if not math.isclose(value, held_then[name], rel_tol=SAME):
                raise JointIdError(
                    f"{name} was held at {held_then[name]:.6g} in the baseline and is held at {value:.6g} now: {advice}"
                )


def _known(row: ParameterEstimate) -> bool:
    return row.verdict is Verdict.ESTIMATED and math.isfinite(row.value) and 0.0 < row.std_dev < math.inf


def _described(estimate: Estimate) -> str:
    options = ", ".join(f"{name}={value}" for name, value in estimate.model_options.items())
    return f"{estimate.model} ({options})" if options else estimate.model
