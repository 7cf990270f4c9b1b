"""An estimate as text: a table, and one line."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.quantities import with_deviation
from joint_id_core.results.estimate import Estimate, ParameterEstimate
from joint_id_core.results.verdict import STRONG_CORRELATION, Verdict


def one_line(estimate: Estimate) -> str:
    """Return one line: model, status, and the estimated parameters."""
    found = [p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED]
    values = "".join(f", {p.name} {with_deviation(p.value, p.std_dev)}" for p in found)
    return f"<Estimate {estimate.model} by {estimate.estimator}: {estimate.status.value}{values}>"


def estimated(estimate: Estimate) -> str:
    """Return the estimated parameters with standard deviations and units; empty if there are none."""
    known = [p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED]
    return ", ".join(f"{p.name} {with_deviation(p.value, p.std_dev, p.unit)}" for p in known)


def beside_others(estimate: Estimate, text: str) -> str:
    """Return what is said of an estimate without the path of its recording, which those of other joints share."""
    return text.removeprefix(f"{estimate.source}: ")


def table(estimate: Estimate) -> str:
    """Return the estimate as lines of text: values, standard deviations, verdicts, fit, strong correlations."""
    head = f"{estimate.model} by {estimate.estimator}: {estimate.status.value}"
    also = [f"    {note}" for note in estimate.notes if note not in estimate.message]
    lines = [head, f"  {estimate.message}", *(["  also:", *also] if also else [])]
    if estimate.status.unusable:
        return "\n".join(lines)  # nothing was fitted
    lines.append("")
    width = max([11, *(len(p.unit) + 1 for p in estimate.parameters)])
    lines.append(f"  {'parameter':<10}{'value':>13}  {'std dev':>10}  {'':>8}  {'unit':<{width}}{'verdict':<12}start")
    lines += [_row(p, width) for p in estimate.parameters]
    doubtful = [p for p in estimate.parameters if p.verdict not in (Verdict.ESTIMATED, Verdict.FIXED) and p.reason]
    lines += ["", *(f"  {p.name}: {p.reason}" for p in doubtful)] if doubtful else []
    if estimate.nrmse:
        lines += ["", f"  {'signal':<16}{'nrmse':>9}  {'noise (std dev)':>16}  whiteness"]
        for name, value in estimate.nrmse.items():
            noise, white = estimate.noise.get(name, math.nan), estimate.whiteness.get(name, math.nan)
            lines.append(f"  {name:<16}{value:>9.2g}  {noise:>16.3g}  {white:>9.2f}")
        inputs = {n: v for n, v in estimate.noise.items() if n not in estimate.nrmse}
        lines += [f"  {name:<34}{v:>8.3g}" for name, v in inputs.items()]
    pairs = correlations(estimate)
    if pairs:
        lines += ["", "  strongly correlated: " + ", ".join(f"{a} and {b} ({r:+.3f})" for a, b, r in pairs)]
    span = f"{estimate.samples} samples, {estimate.end - estimate.start:.3g} s of recording"
    warmth = "" if math.isnan(estimate.temperature) else f" at {estimate.temperature:.1f} deg C"
    lines += ["", f"  {span}{warmth}; {estimate.iterations} iterations, {estimate.substeps} steps a sample, "
              f"{estimate.elapsed_s:.3g} s"]  # fmt: skip
    return "\n".join(lines)


def correlations(estimate: Estimate, threshold: float = STRONG_CORRELATION) -> list[tuple[str, str, float]]:
    """Return pairs of estimated parameters whose absolute correlation exceeds `threshold`, strongest first."""
    if not estimate.free:
        return []
    sd = np.sqrt(np.diag(estimate.covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        r = estimate.covariance / np.outer(sd, sd)
    found = [
        (estimate.free[i], estimate.free[j], float(r[i, j]))
        for i in range(len(sd))
        for j in range(i)
        if abs(r[i, j]) > threshold
    ]
    return sorted(found, key=lambda pair: -round(abs(pair[2]), 3))  # rounded as shown: equal ones keep their order


def _row(p: ParameterEstimate, width: int) -> str:
    value = f"{p.value:>13.6g}"
    share = f"({100 * p.std_dev / abs(p.value):.2g} %)" if p.value and math.isfinite(p.std_dev) else ""
    if p.verdict is Verdict.FIXED:
        deviation = f"{p.std_dev:>10.2g}" if math.isfinite(p.std_dev) else ""
        return f"  {p.name:<10}{value}  {deviation:>10}  {share:>8}  {p.unit:<{width}}{p.verdict.value}"
    return (
        f"  {p.name:<10}{value}  {p.std_dev:>10.2g}  {share:>8}  {p.unit:<{width}}{p.verdict.value:<12}{p.initial:.4g}"
    )
