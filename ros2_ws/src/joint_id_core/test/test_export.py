"""What was identified, written for a simulator: values and uncertainty at the link, URDF and MJCF."""

from __future__ import annotations

import csv
import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.results.at_link import at_link
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

from .online_motion import MODEL, motion

mujoco = pytest.importorskip("mujoco", reason="the exported files are loaded with mujoco, which is not installed")

FLEXIBLE = build("harmonic_drive")
URDF = """<?xml version="1.0"?>
<robot name="arm">
  <!-- made by hand -->
  <link name="base"/><link name="upper"><inertial><mass value="2"/></inertial></link><link name="tool"/>
  <joint name="elbow" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <dynamics damping="9" friction="9"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/></joint>
</robot>
"""
MJCF = """<mujoco><option timestep="0.0002" gravity="0 0 0" integrator="implicitfast"/>
<worldbody><body><inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>
<joint name="elbow" type="hinge" axis="0 0 1" damping="9" solreffriction="0.002 1"/></body></worldbody></mujoco>
"""


def estimate_of(values: dict[str, float], free: tuple[str, ...], covariance: np.ndarray) -> Estimate:
    """An estimate of Model 2 with these values."""
    rows = []
    for q in FLEXIBLE.parameters:
        k = free.index(q.name) if q.name in free else None
        sigma, verdict = (np.nan, Verdict.FIXED) if k is None else (np.sqrt(covariance[k, k]), Verdict.ESTIMATED)
        rows.append(ParameterEstimate(q.name, q.unit, values[q.name], sigma, verdict))
    return Estimate(
        "harmonic_drive", "innovations", Status.CONVERGED, "Converged.", tuple(rows), free, covariance, joint="elbow"
    )


@pytest.fixture
def flexible() -> Estimate:
    """Damping on either side is known to 30 %, their sum at the link to 1 %."""
    values, free = FLEXIBLE.values(), ("c_m", "c_q", "J_m", "tau_fm", "tau_fq")
    scale = np.array([0.3 * values["c_m"], 0.3 * 101.0**2 * values["c_m"], 0.02 * values["J_m"], 1e-4, 0.05])
    correlation = np.eye(5)
    correlation[0, 1] = correlation[1, 0] = -0.9995
    return estimate_of(values, free, correlation * np.outer(scale, scale))


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(URDF)

    def call(*words):
        result = CliRunner().invoke(app, ["export", *map(str, words)])
        return result.exit_code, result.stdout, result.stderr

    return call


def test_uncertainty_at_the_link_is_that_of_draws_from_the_covariance(flexible):
    draws = np.random.default_rng(0).multivariate_normal(
        [flexible[n].value for n in flexible.free], flexible.covariance, 200000
    )
    drawn = dict(zip(flexible.free, draws.T, strict=True))
    seen = {
        "damping": 101.0**2 * drawn["c_m"] + drawn["c_q"],
        "friction": 101.0 * drawn["tau_fm"] + drawn["tau_fq"],
        "armature": 101.0**2 * drawn["J_m"],
    }
    found = {q.name: q for q in at_link(flexible)}
    assert found.keys() == seen.keys()
    for name, values in seen.items():
        assert found[name].value == pytest.approx(values.mean(), rel=0.01)
        assert found[name].std_dev == pytest.approx(values.std(), rel=0.02)
    assert found["damping"].known and found["damping"].std_dev < 0.02 * found["damping"].value
    assert found["damping"].formula == "N^2 c_m + c_q, N = 101"


def test_a_table_is_written_with_and_without_its_option(run, flexible):
    """Who looked for it typed `--csv`, which was refused."""
    flexible.save("good.json")
    plain = run("good.json", "--joint", "elbow")
    assert plain[0] == 0 and "elbow,damping" in plain[1] and run("good.json", "--joint", "elbow", "--csv") == plain


def test_parts_of_the_motor_are_brought_to_the_link_where_there_is_a_gear():
    for name, formulas in (
        (
            "electromechanical",
            {"damping": "N^2 c_b + N^2 c_m + c_q, N = 101", "friction": "N tau_fm + tau_fq, N = 101"},
        ),
        ("dc_motor", {"damping": "c_b", "friction": "tau_fc"}),
        (
            "motor_side",
            {"damping": "N^2 c_m, N = 101", "friction": "N tau_fm, N = 101", "armature": "N^2 J_m, N = 101"},
        ),
    ):
        model = build(name)
        values, free = model.values(), tuple(q.name for q in model.parameters if not q.fixed)
        rows = tuple(ParameterEstimate(n, "", v, 0.0, Verdict.ESTIMATED) for n, v in values.items())
        made = Estimate(name, "innovations", Status.CONVERGED, "", rows, free, np.eye(len(free)))
        assert {q.name: q.formula for q in at_link(made)} == formulas


def test_a_torque_constant_that_is_not_exact_widens_all(flexible):
    constant = ParameterEstimate("k_t", "Nm/A", 0.1, 0.02, Verdict.FIXED)
    current = replace(flexible, parameters=(*flexible.parameters, constant))
    for exact, wide in zip(at_link(flexible), at_link(current), strict=True):
        assert wide.std_dev == pytest.approx(np.hypot(exact.std_dev, 0.2 * exact.value))


def test_a_urdf_keeps_all_else_and_says_where_values_come_from(flexible, run, tmp_path):
    flexible.save(tmp_path / "monday.json")
    code, out, err = run("monday.json", "--urdf", "arm.urdf", "-o", "out.urdf")
    assert (code, out, err) == (0, "out.urdf: what was identified of elbow\n", "")
    text = (tmp_path / "out.urdf").read_text()
    assert "made by hand" in text and "joint_id, monday.json, harmonic_drive by innovations" in text
    assert "no place for: armature" in text
    before, after = (ET.fromstring(t) for t in (URDF, text))
    dynamics = after.find("joint[@name='elbow']/dynamics")
    values = {q.name: q.value for q in at_link(flexible)}
    assert float(dynamics.get("damping")) == pytest.approx(values["damping"], rel=1e-8)
    assert float(dynamics.get("friction")) == pytest.approx(values["friction"], rel=1e-8)
    for element in before.iter():
        if element.tag not in ("dynamics", "robot"):
            assert any(e.tag == element.tag and e.attrib == element.attrib for e in after.iter())


def driven(text: str, time: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """The angle of the joint of an MJCF under a torque that is held between samples."""
    model = mujoco.MjModel.from_xml_string(text)
    data, steps = mujoco.MjData(model), round((time[1] - time[0]) / model.opt.timestep)
    angle = np.empty(len(time))
    for k, tau in enumerate(torque):
        angle[k], data.qfrc_applied[0] = data.qpos[0], tau
        mujoco.mj_step(model, data, steps)
    return angle


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one - other) ** 2)) / np.std(one))


def test_the_exported_rigid_joint_moves_in_mujoco_as_ours_does(run, tmp_path):
    recording = motion(6.0)
    found = fit(MODEL, recording)
    found.updated(joint="elbow").save(tmp_path / "elbow.json")
    (tmp_path / "arm.xml").write_text(MJCF.format(inertia=found["J"].value))
    code, _, err = run("elbow.json", "--mjcf", "arm.xml", "--out", "out.xml")
    assert code == 0 and "J is of rotor and link together" in err
    time, torque = recording.time, multisine(recording.time, 20.0, (0.7, 1.8), seed=9)
    ours = simulate(MODEL, time, {"torque": torque}, found.values)["link_position"]
    tau_0 = found["tau_0"].value
    assert apart(ours, driven((tmp_path / "out.xml").read_text(), time, torque - tau_0)) < 0.02
    assert apart(ours, driven(MJCF.format(inertia=found["J"].value), time, torque - tau_0)) > 0.1


def test_the_exported_flexible_joint_moves_as_ours_with_a_stiff_gear(flexible, run, tmp_path):
    stiff = flexible.values | {"k_1": 2e5}
    flexible.save(tmp_path / "elbow.json")
    (tmp_path / "arm.xml").write_text(MJCF.format(inertia=stiff["J_q"]))
    code, _, _ = run("elbow.json", "--mjcf", "arm.xml", "--out", "out.xml")
    assert code == 0
    time = np.arange(0.0, 4.0, 0.002)
    torque = multisine(time, 0.4, (0.5, 1.3), seed=3)
    ours = simulate(FLEXIBLE, time, {"torque": torque, "external_torque": 0.0 * time}, stiff)["link_position"]
    assert apart(ours, driven((tmp_path / "out.xml").read_text(), time, 101.0 * torque)) < 0.02


def test_csv_and_what_is_not_known(flexible, run, tmp_path):
    wide = flexible.covariance.copy()
    wide[2, 2] = flexible["J_m"].value ** 2
    replace(flexible, covariance=wide).save(tmp_path / "elbow.json")
    code, out, err = run("elbow.json")
    rows = {row["quantity"]: row for row in csv.DictReader(io.StringIO(out))}
    assert code == 0 and rows.keys() == {"damping", "friction"}
    assert "elbow: left out, not known: armature" in err
    code, out, _ = run("elbow.json", "--all", "--joint", "arm,3")
    assert {row["quantity"] for row in csv.DictReader(io.StringIO(out))} == {"damping", "friction", "armature"}
    assert {row["joint"] for row in csv.DictReader(io.StringIO(out))} == {"arm,3"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["good.json", "--urdf", "arm.urdf"], "--urdf needs a file to write"),
        (["good.json", "--urdf", "arm.urdf", "-o", "arm.urdf"], "exists already"),
        (["good.json", "--urdf", "none.urdf", "-o", "x"], "none.urdf: cannot be read"),
        (["good.json", "--urdf", "good.json", "-o", "x"], "not XML"),
        (["good.json", "--mjcf", "arm.urdf", "-o", "x"], "its root is <robot>, that of MJCF is <mujoco>"),
        (
            ["good.json", "--urdf", "arm.urdf", "-o", "x", "--joint", "knee"],
            "has no joint 'knee': it has elbow",
        ),
        (["good.json", "--urdf", "arm.urdf", "-o", "x", "--joint", "flange"], "joint flange is fixed"),
        (["good.json", "--urdf", "arm.urdf", "--mjcf", "arm.urdf", "-o", "x"], "exclude each other"),
        (["good.json", "--csv", "--ros-params"], "exclude each other"),
        (["good.json", "good.json"], "two estimates are of joint elbow"),
        (["good.json", "--joint", "a", "--joint", "b"], "2 names and 1 estimates"),
        (["poor.json"], "poor_fit, not a good estimate"),
        (["nameless.json"], "a joint without a name"),
        (["good.json", "-o", "no/such/x.csv"], "cannot be written"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(flexible, run, tmp_path, words, says):
    flexible.save(tmp_path / "good.json")
    replace(flexible, status=Status.POOR_FIT).save(tmp_path / "poor.json")
    replace(flexible, joint="").save(tmp_path / "nameless.json")
    code, out, err = run(*words)
    assert code == 2 and out == "" and says in err and err.count("\n") == 1
    assert not (tmp_path / "x").exists() and (tmp_path / "arm.urdf").read_text() == URDF


def world(joints: str) -> str:
    return f'<mujoco><equality><joint name="elbow"/></equality><worldbody>{joints}</worldbody></mujoco>'


XACRO = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
MACRO = '<xacro:macro name="arm"><joint name="elbow" type="revolute"/></xacro:macro>'


@pytest.mark.parametrize(
    ("kind", "text", "says"),
    [
        ("urdf", URDF.replace('"flange" type', '"elbow" type'), "two joints of the name elbow: give each"),
        ("urdf", URDF.replace("<limit", '<mimic joint="wrist"/><limit'), "joint elbow follows joint wrist (<mimic>)"),
        ("urdf", XACRO.format(MACRO), "has no joint with a name: if it is a xacro, expand it first (xacro in >"),
        ("urdf", XACRO.format(MACRO + '<joint name="elbow" type="revolute"/>'), "is a xacro: expand it first (xacro"),
        ("urdf", URDF.replace('"elbow"', '"${prefix}elbow"'), "is a xacro: expand it first (xacro in > robot.urdf)"),
        ("urdf", URDF.replace(' type="revolute"', ""), "joint elbow is of no type: only revolute"),
        ("mjcf", world('<joint name="elbow" type="ball"/>'), "joint elbow is ball: only hinge, slide"),
        ("mjcf", world('<joint name="elbow" type="free"/>'), "joint elbow is free: only hinge, slide"),
        ("mjcf", world('<freejoint name="elbow"/>'), "joint elbow is free: only hinge, slide"),
        ("mjcf", world(2 * '<joint name="elbow"/>'), "two joints of the name elbow"),
        ("mjcf", world('<joint name="shoulder"/>'), "no joint 'elbow': it has shoulder"),  # a constraint is no joint
        ("mjcf", world("<joint/>"), "has no joint with a name"),
    ],
)
def test_a_description_in_which_no_such_joint_moves_by_itself_is_refused(flexible, run, tmp_path, kind, text, says):
    flexible.save(tmp_path / "good.json")
    (tmp_path / "in").write_text(text)
    code, out, err = run("good.json", f"--{kind}", "in", "-o", "x")
    assert code == 2 and out == "" and says in err and err.count("\n") == 1 and not (tmp_path / "x").exists()


@pytest.mark.parametrize("words", [(), ("--urdf", "arm.urdf"), ("--ros-params",)])
def test_a_number_that_is_not_finite_is_never_written(run, tmp_path, words):
    """A fit that failed has values without a covariance, and not even a torque constant if none was given."""
    rows = tuple(
        ParameterEstimate(q.name, q.unit, q.nominal, np.nan, Verdict.FIXED if q.fixed else Verdict.NOT_EXCITED)
        for q in build("rigid_joint", actuation="current").parameters
    )
    free, unknown, options = ("J", "c", "tau_f", "tau_0"), np.full((4, 4), np.nan), {"actuation": "current"}
    failed = Estimate("rigid_joint", "hpinn", Status.POOR_FIT, "", rows, free, unknown, model_options=options)
    failed.save(tmp_path / "elbow.json")
    code, _, err = run("elbow.json", "--joint", "elbow", "--all", "-o", "out", *words)
    assert code == 0 and not re.search(r"\b(nan|inf)\b", (tmp_path / "out").read_text())
    assert "--ros-params" in words or "elbow: left out, not known: damping" in err


def test_a_name_that_would_break_the_file_is_refused(flexible, run, tmp_path):
    flexible.save(tmp_path / "good.json")
    code, out, err = run("good.json", "--ros-params", "--joint", "el: bow\n- x")
    assert code == 2 and out == "" and r"joint 'el: bow\n- x' cannot be printed: give another" in err


def test_a_file_is_yaml_or_xml_whatever_the_file_of_the_estimate_is_called(flexible, run, tmp_path):
    name = "a---b\n- x: [.json"
    flexible.save(tmp_path / name)
    code, out, _ = run(name, "--ros-params", "--joint", "el: bow")
    assert code == 0 and yaml.safe_load(out)["/**/identifier"]["ros__parameters"]["joints"] == ["el: bow"]
    assert run(name, "--urdf", "arm.urdf", "-o", "out.urdf")[0] == 0
    assert ET.parse(tmp_path / "out.urdf").getroot().tag == "robot"


def test_a_parameter_file_needs_estimates_of_one_model(flexible, run, tmp_path):
    replace(flexible, joint="elbow").save(tmp_path / "elbow.json")
    replace(fit(MODEL, motion()), joint="wrist").save(tmp_path / "wrist.json")
    code, _, err = run("elbow.json", "wrist.json", "--ros-params")
    assert code == 2 and "joint wrist is of another model" in err
    code, _, err = run("elbow.json", "--ros-params", "--urdf", "arm.urdf", "--out", "x.urdf")
    assert code == 2 and "exclude each other" in err
