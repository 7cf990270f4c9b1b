"""Fit of several recordings of one joint.

Every recording is fitted by itself, with its own start and noise; then what they say is put together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.quantities import with_deviation
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.together.information import Space, added, scatter, share_of
from joint_id_core.estimators.together.judging import common, judge, own
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

USABLE = (Status.CONVERGED, Status.DISAGREE, Status.UNINFORMATIVE)


def as_it_is(recording: Recording) -> Recording:
    """Return the recording: it is fitted as it is."""
    return recording


@dataclass(frozen=True)
class Together:
    """The estimate from several recordings, the estimate of each, and how far each is from all.

    Attributes:
        estimate: from all recordings that could be used.
        alone: of every recording by itself.
        apart: by recording, the distance of its values from the sum of all, in standard deviations of the distance, by
            parameter; empty for a recording that was left out.
        as_fitted: returns a recording of the joint as these were fitted, with the load that was found.
    """

    estimate: Estimate
    alone: tuple[Estimate, ...]
    apart: tuple[dict[str, float], ...]
    as_fitted: Callable[[Recording], Recording] = as_it_is

    def __str__(self) -> str:
        """Return the estimate as a table, and a line for every recording."""
        lines = [str(self.estimate), "", "  each recording by itself, and its distance from the sum of all in sigma:"]
        for one, apart in zip(self.alone, self.apart, strict=True):
            values = [f"{n} {with_deviation(one[n].value, one[n].std_dev)} ({d:+.1f})" for n, d in apart.items()]
            lines.append(f"  {one.source}: {one.status.value}{'; ' if values else ''}{', '.join(values)}")
        return "\n".join(lines)


def together(model: Model, alone: Sequence[Estimate], settings: ParameterSettings | None = None) -> Together:
    """Put the estimates of several recordings of one joint together.

    Args:
        model, settings: with which each was fitted.
        alone: the estimate of each recording by itself.

    Raises:
        JointIdError: there is no recording.
    """
    if not alone:
        raise JointIdError("no recording: give at least one")
    used = [k for k, e in enumerate(alone) if e.status in USABLE]
    apart: list[dict[str, float]] = [{} for _ in alone]
    if not used or len(alone) == 1:
        return Together(alone[0], tuple(alone), tuple(apart))
    if len(used) == 1:
        one = alone[used[0]]
        status, notes = judge(alone, used, {row.name: row for row in one.parameters}, apart)
        notes = (*notes, *(note for note in one.notes[1:] if note not in notes))
        return Together(one.noted(notes, status=status), tuple(alone), tuple(apart))
    space = Space(model, alone[used[0]], settings or ParameterSettings())
    shares = [share_of(space, alone[k]) for k in used]
    z, covariance = added(space, shares)
    z, scale, distances = scatter(space, shares, z, covariance)
    for k, away in zip(used, distances, strict=True):
        apart[k] = {n: float(d) for n, d in zip(space.names, away, strict=True) if np.isfinite(d)}
    known = z, covariance * np.outer(scale, scale)
    return Together(_estimate(model, space, alone, used, known, apart), tuple(alone), tuple(apart))


def _estimate(
    model: Model,
    space: Space,
    alone: Sequence[Estimate],
    used: Sequence[int],
    known: tuple[Array, Array],
    apart: Sequence[dict[str, float]],
) -> Estimate:
    """Return the estimate of all, from `known` coordinates (k,) and their covariance (k, k)."""
    z, covariance = known
    parts = [alone[k] for k in used]
    first, values, slope, sigma = parts[0], space.values(z), space.slope(z), np.sqrt(np.diag(covariance))
    found = {
        name: common(space, [e[name] for e in parts], k, float(values[k]), float(sigma[k] * slope[k]), float(sigma[k]))
        for k, name in enumerate(space.names)
    }
    parameters = tuple(found.get(p.name) or own(model, [e[p.name] for e in parts]) for p in first.parameters)
    status, notes = judge(alone, used, found, apart)
    return first.noted(
        notes, status=status, parameters=parameters, free=space.names,
        covariance=np.nan_to_num(covariance, posinf=0.0) * np.outer(slope, slope), checks=None, predictions=None,
        changes=(), deviance=float("nan"), nrmse={n: max(e.nrmse.get(n, 0.0) for e in parts) for n in first.nrmse},
        observations=sum(e.observations for e in parts), samples=sum(e.samples for e in parts),
        iterations=sum(e.iterations for e in parts), elapsed_s=sum(e.elapsed_s for e in alone),
        start=0.0, end=sum(e.end - e.start for e in parts), origin=0, source=", ".join(e.source for e in parts),
        temperature=float(np.mean([e.temperature for e in parts])),
    )  # fmt: skip
