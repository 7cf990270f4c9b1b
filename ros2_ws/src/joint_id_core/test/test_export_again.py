"""Descriptions that were exported before, have comments above all, slide, or include others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict

LICENCE = "<!-- (C) the maker of the arm -->"
URDF = f"""<?xml version="1.0" encoding="utf-8"?>
{LICENCE}
<robot name="arm">
  <link name="base"/><link name="upper"/>
  <joint name="elbow" type="revolute">
    <parent link="base"/><child link="upper"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/>
  </joint>
</robot>
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF)
    model = build("rigid_joint")
    values, free = model.values(), ("c", "tau_f")
    rows = tuple(ParameterEstimate(q.name, q.unit, values[q.name], 1e-3, Verdict.ESTIMATED) for q in model.parameters)
    for name in ("monday", "friday"):
        made = Estimate("rigid_joint", "innovations", Status.CONVERGED, "Converged.", rows, free, 1e-6 * np.eye(2),
                        joint="elbow")  # fmt: skip
        made.save(Path(f"{name}.json"))

    def call(*words):
        result = CliRunner().invoke(app, [*words])
        return result.exit_code, result.stderr

    return call


def test_a_second_export_replaces_the_comment_of_the_first_and_what_stands_above_all_stays(run):
    assert run("export", "monday.json", "--urdf", "arm.urdf", "-o", "one.urdf")[0] == 0
    assert run("export", "friday.json", "--urdf", "one.urdf", "-o", "two.urdf")[0] == 0
    text = Path("two.urdf").read_text()
    assert "friday.json" in text and "monday.json" not in text and text.count("joint_id, ") == 1
    assert text.splitlines()[1] == LICENCE and text.count(LICENCE) == 1
    assert text.replace("friday", "monday") == Path("one.urdf").read_text()


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_the_units_of_a_joint_that_slides_are_those_of_forces(run, kind):
    body = '<mujoco><worldbody><joint name="elbow" type="slide"/></worldbody></mujoco>'
    Path("in").write_text(body if kind == "mjcf" else URDF.replace("revolute", "prismatic"))
    assert run("export", "monday.json", f"--{kind}", "in", "-o", "out")[0] == 0
    text = Path("out").read_text()
    assert " N s/m = c;" in text and " N = tau_f" in text and "Nm" not in text


def test_an_mjcf_that_includes_the_robot_names_its_file(run):
    Path("scene.xml").write_text('<mujoco><include file="ur5e.xml"/><worldbody><geom size="1"/></worldbody></mujoco>')
    code, said = run("export", "monday.json", "--mjcf", "scene.xml", "-o", "out.xml")
    assert code == 2 and "has no joint, it includes ur5e.xml: give the file that has the joints" in said


def test_a_file_that_is_no_table_is_named_by_history_as_such(run):
    code, said = run("history", "arm.urdf")
    assert code == 2 and "arm.urdf: no table of batch: give one, or files of fit --save (.json)" in said
