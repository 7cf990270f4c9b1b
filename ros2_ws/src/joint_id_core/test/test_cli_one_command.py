"""`joint-id fit FILE` without a model: it takes what the signals allow, says so, and says what to do next."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.cli.fit import _again
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings, fit_several
from joint_id_core.jobs import fit_job
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.jobs.given import Given
from joint_id_core.models import build
from joint_id_core.results.status import Status
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .online_motion import TRUTH, motion


def pasted(output: str) -> list[str]:
    """The words of the command after `joint-id` that the program proposes to repeat its fit."""
    line = next(line for line in output.splitlines() if line.startswith("the same"))
    return shlex.split(line.partition("joint-id ")[2])


def test_a_file_as_people_write_it_is_all_it_takes(tmp_path, run_here):
    record = motion(6.0)
    table = np.column_stack([1e3 * record.time, np.rad2deg(record["link_position"]), record["torque"]])
    lines = [" , ".join(f"{v:.10g}" for v in row) for row in table]
    (tmp_path / "my log.txt").write_text(
        "# from the lab\nTime (ms), Link position (deg), Torque (Nm)\n" + "\n".join(lines)
    )
    code, out = run_here("fit", "my log.txt")
    assert code == 0, out
    assert "time_s = 0.001 * Time (ms)" in out and "link_position = 0.0174533 * Link position (deg)" in out
    assert "model rigid_joint: the link is measured" in out
    again = pasted(out)
    assert again[-2:] == ["--save", "estimate.json"] and "my log.txt" in again
    code, _ = run_here(*again)
    assert code == 0
    saved = json.loads((tmp_path / "estimate.json").read_text())
    found = {p["name"]: p for p in saved["parameters"]}
    for name, truth in TRUTH.items():
        assert abs(found[name]["value"] - truth) < 4.0 * found[name]["std_dev"]


def test_gravity_is_taken_where_the_motion_shows_it(tmp_path, run_here):
    time = np.arange(0.0, 8.0, 0.004)
    torque = multisine(time, 25.0, (0.3, 0.9, 2.1), seed=2)
    truth = TRUTH | {"a_g": 8.0, "b_g": 3.0}
    moved = simulate(build("rigid_joint", gravity=True), time, {"torque": torque}, truth)
    seen = Sensors(noise={"link_position": 1e-5}).measure(moved, 1, keep=("link_position",))
    formats.write(tmp_path / "log.csv", seen.with_channels({"torque": torque}))
    code, out = run_here("fit", "log.csv")
    assert code == 0 and "model rigid_joint with gravity: the link is measured, and with gravity" in out
    assert "--gravity" in pasted(out)
    code, out = run_here(
        "fit", "log.csv", "--friction", "coulomb_viscous", "--estimator", "regression", "--band-hz", "8"
    )
    assert code == 0
    words = " ".join(pasted(out))
    assert "--friction coulomb_viscous" in words and "--estimator regression --band-hz 8" in words
    assert run_here(*pasted(out))[0] == 0


def with_two_encoders(seconds):
    """A rigid joint with the encoders of both sides of a gear, which allows a flexible joint."""
    rigid = motion(seconds)
    noise = 0.3 * np.random.default_rng(0).standard_normal(len(rigid))
    velocity = 101.0 * np.gradient(rigid["link_position"], rigid.time) + noise
    channels = {"link_position": rigid["link_position"], "motor_velocity": velocity, "torque": rigid["torque"]}
    return Recording(rigid.time, channels)


def of_two_encoders(path):
    """Write its log."""
    formats.write(path, with_two_encoders(6.0))


def test_a_model_that_does_not_describe_the_motion_is_left_out_and_said(tmp_path, run_here):
    of_two_encoders(tmp_path / "log.csv")
    code, out = run_here("fit", "log.csv")
    assert code == 0 and "model rigid_joint" in out
    assert "harmonic_drive was tried and left out: " in out


@pytest.mark.parametrize(("flexible", "fitted"), [(False, [1000]), (True, [1000, 4000])])
def test_a_flexible_joint_is_tried_on_a_part_of_a_long_recording_first(monkeypatch, flexible, fitted):
    """All of a UR3e's or UR10e's log took it 6 to 24 s a joint, and told the same."""
    recording = simulate_motion(build("harmonic_drive"), 8.0) if flexible else with_two_encoders(16.0)
    tried = []

    def noted(model, recordings, *others):
        if model.name == "harmonic_drive":
            tried.append(sum(map(len, recordings)))
        return fit_several(model, recordings, *others)

    monkeypatch.setattr(fit_job, "fit_several", noted)
    job = FitJob((), None, {}, None, None, {}, ParameterSettings(), Innovations())
    found = job.run(Given([recording]))
    assert tried == pytest.approx(fitted, abs=1)
    assert found.job.model_options["model"] == ("harmonic_drive" if flexible else "rigid_joint")
    assert flexible or any("was tried on the 4 s with the most motion and left out: " in why for why in found.why)


def test_where_a_flexible_joint_failed_the_gear_by_itself_is_proposed():
    """As of a UR3e's shoulder, whose load is that of the other joints."""
    found = SimpleNamespace(
        job=SimpleNamespace(model_options={"model": "rigid_joint", "gravity": True}),
        estimate=SimpleNamespace(converged=False, status=Status.POOR_FIT),
        why=("model rigid_joint with gravity: ...", "harmonic_drive was tried and left out: ..."),
    )
    *_, last = _again([Path("my log.csv")], found, {"robot": "ur3e", "joint": "lift"})
    assert last.endswith("joint-id fit 'my log.csv' --model motor_side --robot ur3e --joint lift")
    found.why = found.why[:1]
    assert not any("motor_side" in text for text in _again([Path("log.csv")], found, {}))
    found.estimate.status = Status.BAD_DATA
    assert _again([Path("log.csv")], found, {}) == [], "a command that fails again is of no use"


def test_a_regression_gets_the_richest_model_that_it_suits(tmp_path, run_here):
    of_two_encoders(tmp_path / "log.csv")
    code, out = run_here("fit", "log.csv", "--estimator", "regression")
    assert code == 0 and "model rigid_joint" in out and "harmonic_drive" not in out
    code, out = run_here("fit", "log.csv", "--estimator", "regression", "--model", "harmonic_drive")
    assert code != 0 and "estimator regression does not suit model harmonic_drive" in out


def test_every_joint_of_a_bag_is_a_row(tmp_path, run_here, in_this_process):
    one = motion(4.0)
    formats.write_bag(tmp_path / "bag", {"shoulder": one, "elbow": motion(4.0, seed=1)})
    code, out = run_here("fit", "bag", "--set", "N=1")
    assert code == 0, out
    rows = [line.split() for line in out.splitlines() if "converged" in line]
    assert [row[:3] for row in rows] == [[j, "rigid_joint", "converged"] for j in ("shoulder", "elbow")]


def test_what_cannot_be_guessed_is_asked_for(tmp_path, run_here):
    record = motion(4.0)
    formats.write(
        tmp_path / "log.csv",
        Recording(record.time, {"link_position": record["link_position"], "current": record["torque"]}),
    )
    code, out = run_here("fit", "log.csv")
    assert code == 2 and "k_t" in out and "--set k_t=" in out
    (tmp_path / "still.csv").write_text("time_s,temperature\n0,20\n1,20\n")
    code, out = run_here("fit", "still.csv")
    assert code == 2 and "no model follows from that" in out


def test_a_table_of_a_motor_bench_needs_no_mapping(tmp_path, run_here):
    """`Motor Voltage (V)` was left alone, and no model followed."""
    record = simulate_motion(build("dc_motor"), 4.0)
    rows = [1e3 * record.time, record["voltage"], record["current"], record["motor_velocity"] * 30.0 / np.pi]
    names = "Time (ms);Motor Voltage (V);Motor Current (A);Motor Speed (rpm)"
    np.savetxt(tmp_path / "my motor.csv", np.column_stack(rows), delimiter=";", header=names, comments="")
    code, out = run_here("fit", "my motor.csv")
    assert code == 0 and "voltage = Motor Voltage (V)" in out and "model dc_motor: the motor is measured" in out


@pytest.fixture
def robot_log(tmp_path):
    """A log as RTDE recorders write it: two of the joints of a robot, of which the second one moves."""
    record = motion(6.0)
    columns = {"timestamp": 4000.0 + record.time}
    for k, moves in enumerate((0.0, 1.0)):
        columns |= {
            f"actual_q_{k}": moves * record["link_position"],
            f"actual_current_{k}": moves * record["torque"] / (101.0 * 0.1),
        }
    names = [*columns]
    rows = [" ".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "robot.csv").write_text("\n".join([" ".join(names), *rows]) + "\n")
    (tmp_path / "arm.yaml").write_text("/**/identifier: {ros__parameters: {set: [N=101, k_t=0.1]}}")
    return "robot.csv"


def test_a_log_of_a_robot_is_read_joint_by_joint(robot_log, run_here, in_this_process):
    code, out = run_here("fit", robot_log, "--robot", "arm.yaml")
    rows = [line.split() for line in out.splitlines() if line.startswith("  shoulder") and ":" not in line]
    assert [row[:3] for row in rows] == [
        ["shoulder_pan_joint", "rigid_joint", "no_motion"], ["shoulder_lift_joint", "rigid_joint", "converged"],
    ]  # fmt: skip
    assert code == 1 and "no good estimate of shoulder_pan_joint" in out
    assert "\n  shoulder_pan_joint: link_position did not change" in out  # of the file, which was just named
    code, out = run_here("fit", robot_log, "--robot", "arm.yaml", "--joint", "shoulder_lift_joint")
    assert code == 0 and "link_position = actual_q_1" in out
    code, out = run_here(*pasted(out), "--json")
    found = {p["name"]: p for p in json.loads(out)["parameters"]}
    assert all(abs(found[n]["value"] - truth) < 4.0 * found[n]["std_dev"] for n, truth in TRUTH.items())
    assert run_here("compare", robot_log, "--robot", "arm.yaml", "--joint", "shoulder_lift_joint")[0] == 0


def test_the_columns_of_a_log_that_are_named_are_one_joint(robot_log, run_here):
    named = ["--map", "link_position=actual_q_1", "--map", "current=actual_current_1"]
    code, out = run_here("fit", robot_log, *named, "--set", "N=101", "--set", "k_t=0.1")
    assert code == 0 and "current = actual_current_1" in out


@pytest.mark.long
def test_a_joint_that_a_log_does_not_have_is_named_and_what_all_joints_lack_is_said_once(robot_log, run_here):
    code, out = run_here("fit", robot_log, "--joint", "elbow_joint")
    assert code == 2 and "no joint 'elbow_joint': it holds shoulder_pan_joint, shoulder_lift_joint" in out
    code, out = run_here("fit", robot_log)
    assert code == 2 and out.count("needs k_t") == 1 and "(--robot ur3e, ur5e, ur10e)" in out


@pytest.mark.long
def test_a_table_of_several_joints_is_fitted_joint_by_joint(tmp_path, run_here, in_this_process):
    records = {1: motion(6.0), 2: motion(6.0, seed=1)}
    columns = {"t": records[1].time}
    for k, record in records.items():
        columns |= {f"q{k}": record["link_position"], f"tau{k}": record["torque"]}
    rows = [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "table.csv").write_text("\n".join([",".join(columns), *rows]) + "\n")
    code, out = run_here("fit", "table.csv")
    assert code == 0 and "link_position = q1, q2\ntorque = tau1, tau2" in out
    rows = [line.split()[:3] for line in out.splitlines() if line.startswith("  joint_")]
    assert rows == [["joint_1", "rigid_joint", "converged"], ["joint_2", "rigid_joint", "converged"]]
    assert "joints move at the same time" in out and "joint-id arm fit robot.urdf table.csv" in out
    code, out = run_here("fit", "table.csv", "--joint", "joint_2")
    assert code == 0 and "torque = tau2" in out
    code, out = run_here(*pasted(out), "--json")
    found = {p["name"]: p for p in json.loads(out)["parameters"]}
    assert all(abs(found[n]["value"] - truth) < 4.0 * found[n]["std_dev"] for n, truth in TRUTH.items())


def test_other_models_are_compared_with_the_options_of_the_fit(tmp_path, run_here):
    time = np.arange(0.0, 8.0, 0.004)
    wrong = multisine(time, 25.0, (0.3, 0.9, 2.1), seed=2), multisine(time, 0.5, (0.4, 1.3), seed=5)
    np.savetxt(tmp_path / "log.csv", np.column_stack([time, *wrong]), header="when,u,x", delimiter=",", comments="")
    columns = ("--map", "time_s=when", "--map", "torque=2*u", "--map", "link_position=x", "--end", "7.5")
    code, out = run_here("fit", "log.csv", *columns)
    assert code == 1
    line = next(line for line in out.splitlines() if line.startswith("other models: "))
    assert shlex.split(line.partition(": ")[2]) == ["joint-id", "compare", "log.csv", *columns]
