"""Estimates that fight their prior: the data want another value than the prior lets them have."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.models import Model

FAR = 2.0  # standard deviations of the prior between its mean and what the data want
MATTERS = 0.5  # standard deviations of the estimate by which the prior pulls it, from which the user is told
MOST = 2  # parameters that are told: a message is to be read
UNKNOWN = 0.95  # standard deviation of the estimate over that of the prior from which the data say nothing
# Standard deviation of a logarithm from which data that want less tell an upper limit only: their likelihood is flat
# down to zero, and where it falls away is no value.
LIMIT = 0.5


def prior_pull(
    model: Model,
    free: Sequence[str],
    coordinates: Coordinates,
    belief: Belief,
    z: Array,
    covariance: Array,
    names: Collection[str],
) -> str:
    """Return what to do about a prior that pulls an estimate; empty if none does.

    A prior of variance P and an estimate of variance C at z come from data alone that say z_d with 1/C - 1/P
    (parameters taken one by one): z_d = z + C / (P - C) (z - z_0).

    Args:
        model, free: names of the estimated parameters.
        coordinates, belief: of these, and the prior.
        z, covariance: estimate (k,) and its covariance (k, k) by noise and prior alone, in coordinates.
        names: of the parameters that may be told.
    """
    told = list[tuple[float, str]]()
    for k, name in enumerate(free):
        prior = 1.0 / math.sqrt(belief.precision[k, k])
        share = math.sqrt(covariance[k, k]) / prior
        if name not in names or share >= UNKNOWN:
            continue
        away = float(z[k] - belief.mean[k])
        if coordinates.positive[k] and away < 0.0 and share * prior > LIMIT:
            continue
        wanted = away / (1.0 - share**2)
        if abs(wanted) > FAR * prior and abs(wanted - away) > MATTERS * share * prior:
            moved = z.copy()
            moved[k] = belief.mean[k] + wanted
            value, start = (float(coordinates.values(x)[k]) for x in (moved, belief.mean))
            unit = model.parameter(name).unit
            far = f"{abs(wanted) / prior:.2g} standard deviations from its prior at {start:.3g}"
            advice = f"use --prior {name}={abs(wanted):.2g}, or start nearer (--set {name}={value:.3g})"
            told.append((abs(wanted) / prior, f"the data want {name} near {value:.3g} {unit}, {far}: {advice}"))
    told.sort(key=lambda pull: -pull[0])
    more = "; others fight their priors less" if len(told) > MOST else ""
    return "; ".join(text for _, text in told[:MOST]) + more
