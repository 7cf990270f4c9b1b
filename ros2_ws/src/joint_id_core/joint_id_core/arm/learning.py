"""What the first stretches of motion tell of an arm: the batch fit, as a belief that later motion makes sharper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.belief import GRAVITY, KINDS, UNKNOWN, Belief, Scores
from joint_id_core.arm.description import Description
from joint_id_core.arm.drift import drift
from joint_id_core.arm.equations import PAYLOAD, Equations, joined
from joint_id_core.arm.faults import Faults
from joint_id_core.arm.friction import shows_bend
from joint_id_core.arm.judged import rotor
from joint_id_core.arm.links import consistent_links
from joint_id_core.arm.recorded_otherwise import recorded_otherwise
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked
from joint_id_core.arm.suspects import suspects
from joint_id_core.data.recording import Array
from joint_id_core.results.verdict import Verdict


def learned(
    parts: Sequence[Equations], beforehand: Beforehand | None = None, description: Description | None = None
) -> Belief:
    """Return the belief from the first stretches of motion. What the arm carries in all of them counts to it.

    Args:
        parts: the stretches.
        beforehand: what is known of the arm; without, what joints that stand leave open seems to be known.
        description: of the arm; without, no faults of the samples are looked for.

    Raises:
        JointIdError: they are too short for the number of parameters.
    """
    whole = replace(joined(parts), loaded=False)
    table = Stacked.of([whole], beforehand)
    values, sigma = table.weighed()
    left = table.y - table.columns @ values
    covariance, lag = table.covariance(table.columns, left, sigma, table.precision)
    count, own = table.count, len(values)
    weighted = table.columns / sigma[table.joint, None]
    white = np.linalg.pinv(weighted.T @ weighted, hermitian=True)
    shown = np.any(table.columns != 0.0, axis=0)
    friction = np.arange(whole.base, whole.base + 2 * count).reshape(2, count)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.where(shown, np.diag(covariance) / np.diag(white), np.nan)[friction]
    colour = np.ones(count)
    moves = np.isfinite(ratios).any(axis=0)
    colour[moves] = np.maximum(1.0, np.nanmean(ratios[:, moves], axis=0))
    size = own + PAYLOAD + count
    place = np.concatenate([np.arange(whole.base), np.arange(whole.base + PAYLOAD, own + PAYLOAD)])
    all_values, all_covariance, seen = np.zeros(size), np.zeros((size, size)), np.zeros(size, dtype=bool)
    all_values[place], seen[place] = values, shown
    seen[whole.base + PAYLOAD + 2 * count + np.flatnonzero(~shows_bend(whole))] = False
    known = np.diag(table.precision) > 0.0
    spread = _positive(covariance + np.diag(np.where(shown | known, 0.0, UNKNOWN**2)))
    means, offsets, noise = np.zeros((count, own)), np.zeros(count), np.full(count, UNKNOWN**2)
    mean, torque = np.zeros(count), np.zeros(count)
    for j in range(count):
        used = whole.used[:, j]
        if used.any():
            means[j] = whole.columns[used, j].mean(axis=0)[place]
            mean[j], torque[j] = whole.y[used, j].mean(), whole.y[used, j].var()
            offsets[j] = mean[j] - means[j] @ values
            noise[j] = sigma[j] ** 2 * colour[j] / np.count_nonzero(used)
    end = slice(size - count, size)
    all_values[end], seen[end] = offsets, whole.used.any(axis=0)
    all_covariance[np.ix_(place, place)] = spread
    all_covariance[end, end] = means @ spread @ means.T + np.diag(noise)
    all_covariance[end, place] = -means @ spread
    all_covariance[place, end] = -spread @ means.T
    faults, regressor = Faults((), np.zeros(size)), None
    if description is not None:
        regressor = Regressor(description)
        at_all = np.insert(values, whole.base, np.zeros(PAYLOAD))
        found = suspects(description, [whole], table, values, at_all, lag)
        faults.shift[place], faults.shift[end] = found.shift, found.torque - means @ found.shift
        gross = recorded_otherwise(description, regressor, [whole], beforehand) or found.gross
        faults = replace(faults, texts=found.texts, gross=gross, amounts=found.amounts)
    belief = Belief(
        all_values, all_covariance, whole.base, sigma, colour, mean, torque, False, seen,
        sum(p.duration for p in parts), Scores.none(count, KINDS + GRAVITY),
        drift(table, left, friction, values[friction], lag), faults,
    )  # fmt: skip
    if regressor is None or faults.gross:
        return belief
    return replace(belief, faults=replace(faults, gross=_contradiction(regressor, belief)))


def _contradiction(regressor: Regressor, belief: Belief) -> str:
    """Return why no bodies have the base parameters of a belief; empty if some have."""
    base, seen = slice(belief.base), belief.seen[: belief.base]
    values, known = belief.values[base], belief.told_covariance[base, base] * np.outer(seen, seen)
    sigma = np.sqrt(np.diag(known))
    rotors = [rotor(regressor, j, float(values[j]), sigma[j], seen[j]) for j in range(belief.count)]
    inertias = [found.value if found.verdict is Verdict.ESTIMATED else 0.0 for found in rotors]
    return consistent_links(regressor, values, known, inertias).contradiction


def _positive(covariance: Array) -> Array:
    """Return a covariance (P, P) without the negative eigenvalues of rounding, which is large where columns depend."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, 1.0)
    sizes, axes = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray((axes * np.maximum(sizes, 0.0)) @ axes.T * np.outer(size, size))
