"""What a person reads and a machine parses of an estimate."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict
from joint_id_core.results.plot import broken
from joint_id_core.results.report import correlations, table


def make_estimate(**changes) -> Estimate:
    rows = (
        ParameterEstimate("J", "kg m^2", 1.25, 0.05, Verdict.ESTIMATED, 1.0),
        ParameterEstimate("c", "Nm s/rad", 10.0, 0.4, Verdict.PRIOR, 8.0),
        ParameterEstimate("tau_0", "Nm", 0.0, 0.1, Verdict.NOT_EXCITED, 0.0),
        ParameterEstimate("N", "1", 101.0, math.nan, Verdict.FIXED),
    )
    sd = np.array([0.05, 0.4, 0.1])
    r = np.array([[1.0, -0.99, 0.2], [-0.99, 1.0, 0.0], [0.2, 0.0, 1.0]])
    fields = dict(
        model="rigid_joint", estimator="innovations", status=Status.CONVERGED, message="converged", parameters=rows,
        free=("J", "c", "tau_0"), covariance=r * np.outer(sd, sd),
        nrmse={"link_position": 0.02, "link_velocity": math.nan},
        noise={"link_position": 1e-5, "input torque": 0.1}, chi2=1.01, whiteness={"link_position": 0.03},
        substeps=2, iterations=17, elapsed_s=0.25, start=1.0, end=3.0, samples=500,
    )  # fmt: skip
    return Estimate(**(fields | changes))


def test_dictionary_is_valid_json_and_not_a_number_is_null():
    result = json.loads(json.dumps(make_estimate().to_dict(), allow_nan=False))
    assert (result["model"], result["status"], result["message"]) == ("rigid_joint", "converged", "converged")
    assert result["elapsed_s"] == 0.25
    assert (result["start_s"], result["end_s"], result["samples"]) == (1.0, 3.0, 500)
    by_name = {p["name"]: p for p in result["parameters"]}
    assert by_name["J"] == {
        "name": "J",
        "unit": "kg m^2",
        "value": 1.25,
        "std_dev": 0.05,
        "verdict": "estimated",
        "initial": 1.0,
        "reason": "",
    }
    assert by_name["N"]["std_dev"] is None
    assert [f["signal"] for f in result["fit"]] == ["link_position", "link_velocity"]
    assert result["fit"][0] == {"signal": "link_position", "nrmse": 0.02, "noise_std_dev": 1e-5}
    assert result["fit"][1]["nrmse"] is None
    assert np.sqrt(result["covariance"][1][1]) == pytest.approx(0.4)


def test_a_fit_that_failed_is_still_valid_json():
    failed = make_estimate(
        status=Status.NO_MOTION, message="no motion: move the joint", free=(), covariance=np.zeros((0, 0)), nrmse={},
        noise={}, whiteness={}, chi2=math.nan, start=math.nan, end=math.nan,
    )  # fmt: skip
    result = json.loads(json.dumps(failed.to_dict(), allow_nan=False))
    assert result["chi2"] is result["start_s"] is None
    assert result["covariance"] == []
    assert "no motion: move the joint" in table(failed)
    assert "strongly" not in table(failed)


def test_table_has_value_deviation_unit_verdict_and_start_of_every_parameter():
    lines = table(make_estimate()).splitlines()
    assert lines[0] == "rigid_joint by innovations: converged"
    row = next(line for line in lines if line.split()[:1] == ["J"])
    assert row.split() == ["J", "1.25", "0.05", "(4", "%)", "kg", "m^2", "estimated", "1"]
    fixed = next(line for line in lines if line.split()[:1] == ["N"])
    assert fixed.split() == ["N", "101", "1", "fixed"], "nothing is claimed of a fixed parameter"
    zero = next(line for line in lines if line.split()[:1] == ["tau_0"])
    assert "%" not in zero and "not_excited" in zero, "no share of nothing"
    assert any("link_position" in line and "1e-05" in line for line in lines)
    assert any("input torque" in line and "0.1" in line for line in lines)
    assert "500 samples, 2 s of recording; 17 iterations, 2 steps a sample" in lines[-1]


def test_correlations_are_named_strongest_first():
    assert correlations(make_estimate()) == [("c", "J", pytest.approx(-0.99))]
    pairs = correlations(make_estimate(), threshold=0.1)
    assert [(a, b) for a, b, _ in pairs] == [("c", "J"), ("tau_0", "J")]
    assert "strongly correlated: c and J (-0.990)" in table(make_estimate())
    certain = make_estimate(covariance=np.zeros((3, 3)))
    assert correlations(certain) == []


def test_every_status_has_advice():
    for status in Status:
        assert len(status.advice) > 5 and "\n" not in status.advice
    assert "move the joint" in Status.NO_MOTION.advice


def test_a_picture_draws_no_line_across_a_gap():
    time = np.concatenate([np.arange(50) / 100, 3.0 + np.arange(50) / 100])
    at, values = broken(time, np.arange(100.0))
    assert len(at) == 101 and np.isnan([at[50], values[50]]).all()
    assert np.array_equal(np.delete(at, 50), time) and np.array_equal(np.delete(values, 50), np.arange(100.0))
    assert all(np.array_equal(row, time[:50]) for row in broken(time[:50], time[:50]))
