"""Two estimates of a joint compared: what changed, beyond chance."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.results.difference import differences
from joint_id_core.results.estimate import Estimate, Status

from .online_motion import MODEL, motion


@pytest.fixture(scope="module")
def monday() -> Estimate:
    return fit(MODEL, motion(6.0))


@pytest.fixture(scope="module")
def friday() -> Estimate:
    """The same joint on another day."""
    return fit(MODEL, motion(6.0, seed=1))


def with_friction(estimate: Estimate, factor: float) -> Estimate:
    rows = tuple(replace(p, value=factor * p.value) if p.name == "tau_f" else p for p in estimate.parameters)
    return replace(estimate, parameters=rows)


def run(*words):
    result = CliRunner().invoke(app, ["diff", *map(str, words)])
    return result.exit_code, result.output


def test_two_recordings_of_the_same_joint_differ_by_chance_only(monday, friday):
    rows = differences(monday, friday)
    assert [row.name for row in rows] == ["J", "c", "tau_f", "tau_0"]
    assert not any(row.changed for row in rows)
    assert np.sqrt(np.mean([row.sigmas**2 for row in rows])) < 2.5


def test_more_friction_is_told_with_size_and_certainty(monday, friday, tmp_path):
    monday.save(tmp_path / "monday.json")
    with_friction(friday, 1.12).save(tmp_path / "friday.json")
    code, out = run(tmp_path / "monday.json", tmp_path / "friday.json")
    line = next(line for line in out.splitlines() if "tau_f" in line)
    assert code == 1 and line.endswith("sigma: changed") and "+1" in line
    code, out = run(tmp_path / "monday.json", tmp_path / "friday.json", "--json")
    told = {row["name"]: row for row in json.loads(out)["parameters"]}
    assert told["tau_f"]["changed"] and not told["J"]["changed"]
    assert told["tau_f"]["change"] == pytest.approx(0.24, abs=0.05)
    assert told["tau_f"]["sigmas"] == pytest.approx(told["tau_f"]["change"] / told["tau_f"]["std_dev"])


def test_an_estimate_is_not_compared_with_itself(monday, tmp_path):
    monday.save(tmp_path / "a.json")
    fit(MODEL, motion(6.0)).save(tmp_path / "b.json")
    for other in ("a.json", "b.json"):
        code, out = run(tmp_path / "a.json", tmp_path / other)
        assert code == 2
        assert f"a.json, {tmp_path / other}: both are the same estimate, or of the same recording: give one of" in out


def test_of_an_offset_that_may_be_zero_no_share_is_told(monday, friday):
    assert all("%" in row.text for row in differences(monday, friday))
    rows = tuple(replace(p, value=p.std_dev) if p.name == "tau_0" else p for p in monday.parameters)
    offset = differences(replace(monday, parameters=rows), friday)[3]
    assert " Nm, " in offset.text and "%" not in offset.text


def test_what_is_not_known_is_not_compared(monday, friday):
    rows = tuple(replace(p, verdict=p.verdict.PRIOR) if p.name == "J" else p for p in friday.parameters)
    unknown = next(row for row in differences(monday, replace(friday, parameters=rows)) if row.name == "J")
    assert not unknown.changed and np.isnan(unknown.sigmas) and unknown.text == "not known after"


def test_a_poor_fit_is_said_to_be_one(monday, friday, tmp_path):
    monday.save(tmp_path / "a.json")
    replace(friday, status=Status.POOR_FIT).save(tmp_path / "b.json")
    code, out = run(tmp_path / "a.json", tmp_path / "b.json")
    assert code == 1 and "b.json: poor_fit: its intervals cannot be trusted" in out


def test_estimates_that_were_not_made_alike_are_refused(monday, tmp_path):
    held = fit(MODEL, motion(6.0), ParameterSettings({"N": 2.0}))
    with pytest.raises(JointIdError, match="N is held at 1 in one estimate and held at 2 in the other"):
        differences(monday, held)
    other = fit(build("rigid_joint", gravity=True), motion(6.0))
    with pytest.raises(JointIdError, match="options of the model"):
        differences(monday, other)
    monday.save(tmp_path / "a.json")
    code, out = run(tmp_path / "a.json", tmp_path / "none.json")
    assert code == 2 and "none.json" in out


def test_estimates_of_two_joints_are_refused_and_one_without_a_name_is_compared_with_any(monday, friday, tmp_path):
    monday.updated(joint="elbow").save(tmp_path / "a.json")
    friday.updated(joint="wrist").save(tmp_path / "b.json")
    friday.updated(joint="").save(tmp_path / "c.json")
    code, out = run(tmp_path / "a.json", tmp_path / "b.json")
    assert code == 2 and "b.json: one estimate is of joint elbow, the other of joint wrist: give two of the same" in out
    assert run(tmp_path / "a.json", tmp_path / "c.json")[0] == 0


@pytest.mark.parametrize(
    ("was", "now", "says"),
    [('"rigid_joint"', '"rigid_join"', "did you mean rigid_joint"), ('"name": "J"', '"name": "Q"', "no parameter 'Q'")],
)
def test_a_file_of_another_model_or_parameter_is_named(monday, tmp_path, was, now, says):
    monday.save(tmp_path / "a.json")
    (tmp_path / "b.json").write_text((tmp_path / "a.json").read_text().replace(was, now))
    code, out = run(tmp_path / "a.json", tmp_path / "b.json")
    assert code == 2 and "b.json: " in out and says in out and out.count("\n") == 1
