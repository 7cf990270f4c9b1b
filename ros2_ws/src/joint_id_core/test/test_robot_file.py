"""What `--robot` takes from a parameter file of the identifier."""

from __future__ import annotations

import json

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.design.files import write
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.robot_file import joints_of_robot, robot_settings
from joint_id_core.models import build

from .online_motion import motion

TEXT = """
/**/filter:
  ros__parameters: {effort_source: current}
/**/identifier:
  ros__parameters:
    model: rigid_joint
    set: [N=2, k_t=0.5+-10%, elbow.k_t=0.25+-0.1]
    fix: [tau_0=0, wrist.c]
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    (tmp_path / "config").mkdir()
    path = tmp_path / "config/arm.yaml"
    path.write_text(TEXT)
    monkeypatch.chdir(tmp_path)
    return path


def test_a_joint_gets_what_holds_for_all_and_what_names_it(file):
    model = build("rigid_joint", actuation="current")
    elbow, other = (
        robot_settings(str(file), "elbow", model.parameter_names),
        robot_settings("arm", None, model.parameter_names),
    )
    assert elbow.values == {"N": 2.0, "k_t": 0.25, "tau_0": 0.0} and elbow.fixed == ("tau_0",)
    assert other.values["k_t"] == 0.5
    assert elbow.deviations == {"k_t": 0.1} and other.deviations == {"k_t": 0.05}
    assert robot_settings("arm", "wrist", model.parameter_names).fixed == ("tau_0", "c")
    assert (
        "k_t" not in robot_settings("arm", "elbow", build("rigid_joint").parameter_names).values
    )  # this model has none


def test_joints_that_a_table_only_numbers_are_those_of_the_file_in_its_order(file, run):
    file.write_text(TEXT.replace("wrist.c]", "wrist.c=3]"))
    record = motion()
    rows = np.column_stack([record.time, *(record[name] for name in ("link_position", "torque") for _ in range(2))])
    np.savetxt("moves.csv", rows, delimiter=",", header="time,q1,q2,tau_1,tau_2", comments="")
    words = ("fit", "moves.csv", "--robot", "arm", "--model", "rigid_joint", "--json", "--joint")
    for joint, held in (("joint_1", False), ("joint_2", True)):
        found = json.loads(run(*words, joint)[1])
        row = next(row for row in found["parameters"] if row["name"] == "c")
        assert (row["value"] == 3.0 and row["verdict"] == "fixed") is held
        assert "The joints are taken in the order of arm: joint_1 = elbow, joint_2 = wrist." in found["notes"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: [", "cannot be read as YAML"),
        ("a: 1", "no parameters of the node"),
        (TEXT.replace("[N", "[N N"), "of the form"),
        (TEXT.replace("fix: ", "fixx: "), r"identifier has no parameter 'fixx' \(did you mean fix\?\)"),
        (TEXT.replace("[N=2", "[tauf=2"), r"no model has a parameter 'tauf' \(did you mean tau_f\?\)"),
        (TEXT.replace("[N=2, k_t=0.5+-10%, elbow.k_t=0.25+-0.1]", "5"), "set is no list of texts"),
    ],
)
def test_a_file_that_is_no_parameter_file_is_refused(file, text, says):
    file.write_text(text)
    with pytest.raises(JointIdError, match=says):
        robot_settings("arm", None, build("rigid_joint").parameter_names)


def test_the_command_takes_it_and_its_own_settings_have_precedence(file, run):
    record = motion()
    bag = file.parent / "bag"
    current = record.with_channels({"current": record["torque"] / 0.5})
    channels = {n: v for n, v in current.channels.items() if n != "torque"}
    formats.write_bag(bag, {"elbow": type(record)(record.time, channels)})
    _, out, _ = run("fit", bag, "--model", "rigid_joint", "--joint", "all", "--robot", "arm", "--json")
    values = {p["name"]: p["value"] for p in json.loads(out)[0]["parameters"]}
    assert (values["N"], values["k_t"], values["tau_0"]) == (2.0, 0.25, 0.0)
    _, out, _ = run(
        "fit", bag, "--model", "rigid_joint", "--robot", "arm", "--set", "k_t=0.3", "--free", "tau_0", "--json"
    )
    values = {p["name"]: p["value"] for p in json.loads(out)["parameters"]}
    assert values["k_t"] == 0.3 and values["N"] == 2.0 and values["tau_0"] != 0.0


def test_robots_are_known_by_name_in_any_folder_and_without_the_nodes(tmp_path, monkeypatch, run):
    """`--robot ur3e` ended in "no such file" where only the library was installed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    elbow = robot_settings("ur3e", "elbow_joint", build("rigid_joint", actuation="current").parameter_names)
    assert elbow.values["N"] == 101.0 and elbow.values["k_t"] == pytest.approx(0.0802) and elbow.deviations["k_t"] > 0.0
    assert all(len(joints_of_robot(name)) == 6 for name in ("ur3e", "ur5e", "ur10e"))
    time = 0.02 * np.arange(101)[:, None]  # 2 s from rest to rest
    position, velocity = time - np.sin(np.pi * time) / np.pi, 1.0 - np.cos(np.pi * time)
    acceleration = np.pi * np.sin(np.pi * time)
    write(Trajectory(("elbow_joint",), time[:, 0], position, velocity, acceleration), tmp_path / "mine.csv")
    words = ("--robot", "ur3e", "--joint", "elbow", "--model", "rigid_joint", "--motion", "mine.csv")
    code, out, err = run("design", *words)
    assert code == 0, err
    assert "0.0802" in out


@pytest.mark.parametrize("text", [None, "a: 1"])
def test_a_file_of_no_use_is_said_once_before_any_fit(tmp_path, monkeypatch, run, text):
    """It was said of each of six joints, in a table, after all of the file had been read."""
    monkeypatch.chdir(tmp_path)
    record = motion()
    rows = np.column_stack([record.time, *(record[name] for name in ("link_position", "torque") for _ in range(2))])
    np.savetxt("moves.csv", rows, delimiter=",", header="time,q1,q2,tau_1,tau_2", comments="")
    if text is not None:
        (tmp_path / "ur99e").write_text(text)
    for command in (("fit", "moves.csv"), ("report", "moves.csv", "-o", "page.html")):
        code, out, err = run(*command, "--robot", "ur99e")
        assert code == 2 and not out and err.count("\n") == 1
        assert ("known by name: ur10e, ur3e, ur5e" if text is None else "no parameters of the node") in err
