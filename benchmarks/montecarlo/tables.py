"""Many fits of a case in numbers: who converged, errors beside the predicted sigma, and how often intervals hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from montecarlo.draws import Draw

INTERVAL = 1.959964  # standard deviations: 95 %


@dataclass(frozen=True)
class Summary:
    """Statistics of the draws of a case.

    Errors and their ratios are of draws that converged and are not far off, by parameter, relative to the truth. The
    coverage is that of the intervals of all draws that converged, far off or not; `coverage_all` that of all draws
    with a result, whatever they say of themselves.

    Attributes:
        draws, converged, far, coloured, misfit: how many; `far` of those that converged.
        names: of the parameters.
        error, sigma: rms error and median predicted standard deviation.
        ratio, bias: rms and mean of the error over its predicted standard deviation.
        coverage, coverage_all: share of 95 % intervals that hold the truth.
        cpu_ms: median processor time of a fit.
    """

    draws: int
    converged: int
    far: int
    coloured: int
    misfit: int
    names: tuple[str, ...]
    error: Array
    sigma: Array
    ratio: Array
    bias: Array
    coverage: Array
    coverage_all: Array
    cpu_ms: float


def summary(draws: Sequence[Draw]) -> Summary:
    """Statistics; NaN where no draw tells."""
    names = tuple(dict.fromkeys(name for draw in draws for name in draw.errors))
    converged = [draw for draw in draws if draw.converged]
    near = [draw for draw in converged if not draw.far]
    errors, sigmas = _columns(near, names)
    z = errors / sigmas
    return Summary(
        len(draws), len(converged), len(converged) - len(near), sum(draw.coloured for draw in draws),
        sum(draw.misfit for draw in draws), names,
        _mean(errors**2) ** 0.5, np.median(sigmas, axis=0) if near else np.full(len(names), np.nan),
        _mean(z**2) ** 0.5, _mean(z), _coverage(converged, names), _coverage([d for d in draws if d.errors], names),
        1e3 * float(np.median([draw.cpu_s for draw in draws])),
    )  # fmt: skip


def _columns(draws: Sequence[Draw], names: tuple[str, ...]) -> tuple[Array, Array]:
    """Errors and sigmas, shape (draws, names) each; a parameter without an interval has NaN."""
    shape = (len(draws), len(names))
    errors = np.array([[draw.errors.get(n, np.nan) for n in names] for draw in draws]).reshape(shape)
    return errors, np.array([[draw.sigmas.get(n, np.nan) for n in names] for draw in draws]).reshape(shape)


def _coverage(draws: Sequence[Draw], names: tuple[str, ...]) -> Array:
    errors, sigmas = _columns(draws, names)
    # compared, a NaN counts as an interval that does not hold
    return _mean((np.abs(errors) < INTERVAL * sigmas).astype(float))


def _mean(columns: Array) -> Array:
    return np.asarray(np.mean(columns, axis=0) if len(columns) else np.full(columns.shape[1], np.nan))


def _told(columns: Array) -> bool:
    """Whether there is a number for each parameter, and a parameter."""
    return bool(columns.size) and bool(np.isfinite(columns).all())


def block(name: str, found: Summary) -> str:
    """Everything about one case."""
    rows = {
        "rms error, %": (100.0 * found.error, ".3g"),
        "sigma, %": (100.0 * found.sigma, ".3g"),
        "rms error / sigma": (found.ratio, ".2f"),
        "bias / sigma": (found.bias, "+.2f"),
        "coverage of 95 %": (found.coverage, ".3f"),
    }
    head = (
        f"{name}: {found.converged} of {found.draws} converged, {found.far} of them far off, "
        f"{found.coloured} not white, {found.misfit} with a misfit, {found.cpu_ms:.0f} ms a fit\n"
    )
    if not _told(found.ratio):
        return head
    lines = [
        f"{'':<20}" + "".join(f"{n:>8}" for n in found.names),
        *(f"{k:<20}" + "".join(f"{format(v, f):>8}" for v in values) for k, (values, f) in rows.items()),
    ]
    return head + "\n".join(lines) + "\n"


def table(found: Mapping[str, Summary]) -> str:
    """A row for each case; ranges are over the parameters."""
    lines = [
        f"{'':<49}{'draws':>6}{'converged':>11}{'far off':>9}{'not white':>11}{'misfit':>8}{'rms error/sigma':>17}"
        f"{'coverage':>15}{'mean':>7}{'all draws':>11}{'a fit':>9}",
    ]
    for name, s in found.items():
        ranges = (f"{np.min(v):.2f} to {np.max(v):.2f}" if _told(v) else "-" for v in (s.ratio, s.coverage))
        means = (f"{np.mean(v):.3f}" if _told(v) else "-" for v in (s.coverage, s.coverage_all))
        lines.append(
            f"{name:<49}{s.draws:>6}{s.converged:>11}{s.far:>9}{s.coloured:>11}{s.misfit:>8}{next(ranges):>17}{next(ranges):>15}"
            f"{next(means):>7}{next(means):>11}{s.cpu_ms:>6.0f} ms"
        )
    return "\n".join(lines) + "\n"


def methods_table(found: Mapping[str, Sequence[Draw]]) -> str:
    """A row for each method: medians over its draws, whatever these say of themselves, and coverage of all."""
    lines = [
        f"{'':<32}{'draws':>6}{'converged':>11}{'median error':>14}{'worst of nine':>15}{'sigma':>9}"
        f"{'coverage':>10}{'a fit':>10}",
    ]
    for name, draws in found.items():
        s = summary(draws)
        done = [draw for draw in draws if draw.errors]
        errors, sigmas = (np.abs(a) for a in _columns(done, s.names))
        median, worst, sigma = (
            (f"{100.0 * float(np.median(a)):.2g} %" for a in (errors, errors.max(axis=1), sigmas)) if done else "---"
        )
        coverage = f"{np.mean(s.coverage_all):.2f}" if done else "-"
        lines.append(
            f"{name:<32}{s.draws:>6}{s.converged:>11}{median:>14}{worst:>15}{sigma:>9}{coverage:>10}"
            f"{1e-3 * s.cpu_ms:>8.3g} s"
        )
    return "\n".join(lines) + "\n"
