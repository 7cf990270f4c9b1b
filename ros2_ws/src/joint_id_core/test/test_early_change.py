"""A joint that changes soon after its first estimate, when a disagreement may as well be a wrong first estimate."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.estimators import ParameterSettings
from joint_id_core.online import OnlineIdentifier
from joint_id_core.results.estimate import Estimate

from .loaded_joint import FACTOR, INERTIA, RATE, loaded, plant
from .online_motion import batches
from .quick import first_quick

WINDOW_S = 2.0


def estimates(seconds: float, loaded_s: float, size: int = 10) -> list[Estimate]:
    joint = plant()
    identifier = OnlineIdentifier(joint.model, ParameterSettings({"k_t": joint.K_T}))
    found = []
    for samples in batches(loaded(seconds, loaded_s), size):
        estimate = identifier.update(samples)
        identifier.finish()
        if estimate is not None:
            found.append(estimate)
    return found


@pytest.mark.parametrize("loaded_s", first_quick([3.1, 2.3, 2.6]))
def test_a_load_in_the_window_after_the_first_one_is_followed(loaded_s):
    """Fits of all samples, those without the load among them, replaced what was right: 20 s later it was not known."""
    true = FACTOR * plant().values[INERTIA]
    found = estimates(loaded_s + 7.0, loaded_s)
    assert any(e.converged and e.end < loaded_s for e in found)
    later = [e for e in found if e.end > loaded_s + 0.5 * WINDOW_S]
    for e in later:
        assert not e.converged or abs(e[INERTIA].value - true) < 4.0 * e[INERTIA].std_dev
    known = [e for e in later if e.end > loaded_s + 3.0 * WINDOW_S]
    assert known and all(e.converged and abs(e[INERTIA].value - true) < 0.01 * true for e in known)


@pytest.mark.long
@pytest.mark.parametrize("loaded_s", first_quick([3.84, 7.86]))
def test_a_fit_of_all_samples_waits_until_the_newest_were_tested(loaded_s):
    """A load just before the end of such a fit was taken for another minimum, and not followed for 5 s.

    The samples come 13 at a time, so that the blocks that are tested do not end where the fit does.
    """
    true = FACTOR * plant().values[INERTIA]
    found = estimates(loaded_s + 2.5 * WINDOW_S, loaded_s, size=13)
    later = [e for e in found if e.end > loaded_s + WINDOW_S]
    assert later and all(e.converged and abs(e[INERTIA].value - true) < 0.01 * true for e in later)


def test_the_estimates_come_at_every_hop_meanwhile():
    ends = np.array([e.end for e in estimates(3.1 + 7.0, 3.1)])
    assert np.all(np.diff(ends) < 0.5 + 30.0 / RATE) and len(ends) > 15
