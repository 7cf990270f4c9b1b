"""What an estimate with another law of friction gives a simulator, which knows damping and Coulomb friction alone."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict


@pytest.mark.parametrize("law", ["eyring", "stribeck"])
def test_a_law_whose_slope_falls_with_speed_has_no_damping(law, tmp_path):
    """The slope at rest is up to twice that of a motion."""
    model = build("motor_side", friction=law)
    values, free = model.values(), tuple(q.name for q in model.parameters if not q.fixed)
    rows = tuple(ParameterEstimate(q.name, q.unit, values[q.name], 1e-6, Verdict.ESTIMATED) for q in model.parameters)
    covariance = 1e-12 * np.eye(len(free))
    made = Estimate(
        "motor_side", "innovations", Status.CONVERGED, "Converged.", rows, free, covariance, joint="elbow",
        model_options={"friction": law},
    )  # fmt: skip
    made.save(tmp_path / "one.json")
    result = CliRunner().invoke(app, ["export", str(tmp_path / "one.json")])
    names = {row["quantity"] for row in csv.DictReader(io.StringIO(result.stdout))}
    assert result.exit_code == 0 and f"friction law is {law}" in result.stderr
    assert names == ({"armature"} if law == "eyring" else {"armature", "damping", "friction"})
