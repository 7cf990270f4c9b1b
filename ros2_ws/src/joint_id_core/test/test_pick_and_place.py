"""Loads that come and go every few seconds, as in most of the work of such robots."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.estimators import ParameterSettings
from joint_id_core.online import OnlineIdentifier
from joint_id_core.results.estimate import Estimate, Status

from .loaded_joint import FACTOR, INERTIA, carrying, plant
from .online_motion import batches
from .quick import first_quick

WINDOW_S, BEGIN_S, EVERY_S = 2.0, 8.1, 4.3
Loads = tuple[tuple[float, float], ...]
SAME: Loads = tuple((BEGIN_S + EVERY_S * k, FACTOR if k % 2 == 0 else 1.0) for k in range(5))
OTHERS: Loads = tuple((BEGIN_S + EVERY_S * k, factor) for k, factor in enumerate((1.5, 1.0, 1.47, 1.0, 1.52)))
WORK: Loads = tuple((16.0 + 6.0 * k, FACTOR if k % 2 == 0 else 1.0) for k in range(5))  # of ordinary motion


@functools.cache
def watched(loads: Loads, moves_seed: int | None = None) -> list[tuple[Estimate, float, float]]:
    """Estimates, how long in s the load was then the present one, and the true inertia over that without a load."""
    joint = plant()
    identifier = OnlineIdentifier(joint.model, ParameterSettings({"k_t": joint.K_T}))
    found, end_s = [], loads[-1][0] + loads[1][0] - loads[0][0]
    for samples in batches(carrying(end_s, loads, moves_seed=moves_seed), 10):
        estimate = identifier.update(samples)
        if estimate is not None:
            since, factor = max(((s, f) for s, f in loads if s < estimate.end), default=(0.0, 1.0))
            found.append((estimate, estimate.end - since, factor))
    return found


def away(estimate: Estimate, factor: float) -> float:
    """Error of the inertia in standard deviations."""
    row = estimate[INERTIA]
    return abs(row.value - factor * plant().values[INERTIA]) / row.std_dev


@pytest.mark.parametrize(
    "loads", [pytest.param(SAME, id="same load"), pytest.param(OTHERS, id="other loads", marks=pytest.mark.long)]
)
def test_every_load_is_followed_within_a_window(loads):
    later = [(e, age, factor) for e, age, factor in watched(loads) if e.end > BEGIN_S and age > WINDOW_S]
    assert len(later) > 4 * len(loads)
    for estimate, age, factor in later:
        assert estimate.converged, f"{age:.1f} s after the change before {estimate.end:.1f} s: {estimate.message}"
        assert away(estimate, factor) < 4.0
        assert estimate[INERTIA].value == pytest.approx(factor * plant().values[INERTIA], rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("moves_seed", first_quick([3, 1]))
def test_loads_are_followed_in_ordinary_motion(moves_seed):
    """Estimates were poor fits for nine tenths of this time, as long as one load that explains two was believed."""
    later = [(e, factor) for e, age, factor in watched(WORK, moves_seed) if e.end > 16.0 and age > 2.0 * WINDOW_S]
    known = [(e, factor) for e, factor in later if e.status in (Status.CONVERGED, Status.NO_MOTION)]
    assert len(known) > 0.7 * len(later) > 10
    assert all(away(e, factor) < 4.0 for e, factor in known)


def test_what_a_load_does_not_change_stays_known():
    before = next(e for e, _, _ in reversed(watched(SAME)) if e.end < BEGIN_S)
    after = watched(SAME)[-1][0]
    others = [name for name in after.free if name != INERTIA]
    assert all(after[name].std_dev < before[name].std_dev for name in others)


def test_a_load_that_is_put_down_is_told_with_both_values():
    told = {}
    for estimate, _, _ in watched(SAME):
        told |= {round(c.since, 1): c for c in estimate.changes if c.name == INERTIA}
    alone = plant().values[INERTIA]
    down = [c for c in told.values() if c.after < c.before]
    assert len(told) == len(SAME) and len(down) == 2
    assert all(c.sure for c in told.values()), "the first one is, and the others go on with it"
    for change in down:
        assert change.before == pytest.approx(FACTOR * alone, rel=0.02)
        assert change.after == pytest.approx(alone, rel=0.02)
    since = np.array(sorted(told))
    assert np.all(np.abs(since - [s for s, _ in SAME]) < 1.2)
