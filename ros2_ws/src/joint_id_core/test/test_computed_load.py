"""A load that was computed is a derived channel: what that means for data and for estimates, without a robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, Regression, fit, fit_several
from joint_id_core.estimators.shared.computed_load import DAMPING_ERROR, ERROR, where_known, with_doubt
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status, Verdict

from . import flexible_joint
from .online_motion import MODEL, TRUTH, motion

FLEXIBLE = build("harmonic_drive")


def with_load(load: np.ndarray | float) -> Recording:
    recording = motion()
    return recording.with_channels({"external_torque": np.full(len(recording), load)}, derived=True)


@pytest.mark.parametrize("options", [{}, {"estimator": Regression()}], ids=["innovations", "regression"])
def test_a_load_that_is_not_known_is_no_load_of_zero(options):
    estimate = fit(MODEL, with_load(np.nan), **options)
    assert estimate.status is Status.MISSING_SIGNAL and "load of the rest of the arm is not known" in estimate.message


def test_samples_without_a_load_are_left_out():
    recording = with_load(0.0)
    recording["external_torque"][1000:2000] = np.nan
    known = where_known(recording)
    assert len(known) == len(recording) - 1000 and known.derived == recording.derived
    estimate = fit(MODEL, recording)
    assert estimate.converged and abs(estimate["J"].value - TRUTH["J"]) < 4.0 * estimate["J"].std_dev
    measured = replace(recording, derived=frozenset())
    assert where_known(measured) is measured


def estimate_of(changes: tuple[ParameterChange, ...] = ()) -> Estimate:
    """An estimate with two free parameters, known to a thousandth."""
    rows = (
        ParameterEstimate("k_1", "Nm/rad", 1e4, 10.0, Verdict.ESTIMATED),
        ParameterEstimate("c_1", "Nm s/rad", 20.0, 0.02, Verdict.ESTIMATED),
        ParameterEstimate("N", "1", 100.0, float("nan"), Verdict.FIXED),
    )
    covariance = np.array([[100.0, 0.1], [0.1, 4e-4]])
    notes = ("Converged.", *(c.text for c in changes), "Held.")
    return Estimate(
        "harmonic_drive", "innovations", Status.CONVERGED, " ".join(notes), rows, free=("k_1", "c_1"),
        covariance=covariance, changes=changes, notes=notes,
    )  # fmt: skip


def test_flexible_joints_are_known_less_than_a_fit_says():
    known = with_doubt(estimate_of(), FLEXIBLE)
    sigma = np.array([np.hypot(10.0, ERROR * 1e4), np.hypot(0.02, DAMPING_ERROR * 20.0)])
    assert [known[n].std_dev for n in ("k_1", "c_1")] == pytest.approx(sigma.tolist())
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), sigma)
    assert known.covariance[0, 1] / sigma.prod() == pytest.approx(0.1 / (10.0 * 0.02))  # correlations stay
    assert "computed load" in known["c_1"].reason and np.isnan(known["N"].std_dev)
    rigid = fit(MODEL, with_load(0.0))
    assert rigid["J"].std_dev == pytest.approx(fit(MODEL, motion())["J"].std_dev, rel=1e-3)


def test_changes_within_the_doubt_are_not_told():
    small = ParameterChange("k_1", 1e4, 10.0, 1.02e4, 10.0, 5.0)
    large = ParameterChange("k_1", 1e4, 10.0, 1.2e4, 10.0, 5.0)
    assert not with_doubt(estimate_of((small,)), FLEXIBLE).changes
    known = with_doubt(estimate_of((large, small)), FLEXIBLE)
    (change,) = known.changes
    assert change.after == 1.2e4 and change.after_std_dev == pytest.approx(np.hypot(10.0, ERROR * 1.2e4))
    assert known.notes == ("Converged.", change.text, "Held.") and known.message == " ".join(known.notes)


@pytest.mark.long
def test_several_recordings_are_doubtful_as_one_is():
    """What is wrong with a load is the same in all of them, so their number makes nothing more certain."""
    recordings = []
    for seed in (0, 1):
        link = flexible_joint.flexible(seed)["link_position"]
        load = flexible_joint.GRAVITY * (np.cos(link) + 0.6 * np.sin(link))
        recordings.append(flexible_joint.flexible(seed).with_channels({"external_torque": load}, derived=True))
    settings = ParameterSettings({"k_2": 0.0, "c_q": 0.0, "tau_fq": 0.0}, fixed=["k_2", "c_q", "tau_fq"])
    found = fit_several(FLEXIBLE, recordings, settings)
    assert found.estimate["c_1"].std_dev >= DAMPING_ERROR * found.estimate["c_1"].value
    assert all(one["c_1"].std_dev >= DAMPING_ERROR * one["c_1"].value for one in found.alone)


def test_a_bag_keeps_whether_a_load_is_known(tmp_path):
    for name, load in (("known", 2.0), ("unknown", np.nan)):
        recording = with_load(load).slice(0, 100)
        formats.write_bag(tmp_path / name, {"a": recording})
        back = formats.read(tmp_path / name)
        assert back.derived == {"external_torque"}
        np.testing.assert_array_equal(back["external_torque"], recording["external_torque"])
    formats.write_bag(tmp_path / "two", {"a": with_load(2.0).slice(0, 100), "b": motion().slice(0, 100)})
    assert "external_torque" not in formats.read(tmp_path / "two", "b")
