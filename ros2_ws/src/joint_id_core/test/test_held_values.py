"""What is known of the uncertainty of held values stands with an estimate, and changes nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.estimators import ParameterSettings, Regression, fit
from joint_id_core.models import build
from joint_id_core.online.identifier import OnlineIdentifier

from .online_motion import batches, motion

MODEL = build("rigid_joint", actuation="current")
VALUES = {"k_t": 0.1, "N": 1.0}
KNOWN = ParameterSettings(VALUES, deviations={"k_t": 0.02})


@pytest.fixture(scope="module")
def record():
    whole = motion(6.0)
    return whole.with_channels({"current": whole["torque"] / VALUES["k_t"]})


def test_it_stands_in_the_table_and_says_what_scales_with_it(record):
    found, without = (fit(MODEL, record, s, Regression()) for s in (KNOWN, ParameterSettings(VALUES)))
    assert found["k_t"].std_dev == 0.02 and np.isnan(without["k_t"].std_dev)
    assert any("k_t to 20 %" in note and "scale with k_t" in note for note in found.notes)
    assert [found[n] for n in found.free] == [without[n] for n in found.free]
    (row,) = (line for line in str(found).splitlines() if line.startswith("  k_t"))
    assert "(20 %)" in row and row.endswith("fixed")


def test_that_of_an_estimated_parameter_is_told_by_the_data(record):
    found = fit(MODEL, record, ParameterSettings(VALUES, deviations={"J": 1.0}), Regression())
    assert found["J"].std_dev < 0.1 and not any("held values" in note for note in found.notes)


def test_it_is_published_online(record):
    identifier = OnlineIdentifier(MODEL, KNOWN)
    found = [e for e in map(identifier.update, batches(record)) if e is not None]
    assert found[-1].converged and found[-1]["k_t"].std_dev == 0.02


def test_settings_with_precedence_bring_their_own():
    other = ParameterSettings({"k_t": 0.2, "N": 100.0}, deviations={"k_t": 0.05, "N": 1.0})
    assert KNOWN.over(other).deviations == {"k_t": 0.02}
    assert ParameterSettings({"k_t": 0.3}).over(other).deviations == {"N": 1.0}
