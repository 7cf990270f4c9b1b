"""`joint-id fit --urdf`: a joint of an arm whose joints all move, from one bag and the robot's description."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from joint_id_core import formats

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

TRUTH = dict(zip(JOINTS, zip(VISCOUS, COULOMB, strict=True), strict=True))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two bags of the arm and its description."""
    place = tmp_path_factory.mktemp("arm")
    (place / "arm.urdf").write_text(URDF)
    formats.write_bag(place / "moves", moving_arm.rigid(8.0))
    formats.write_bag(place / "again", moving_arm.rigid(5.0, seed=7))
    formats.write_bag(place / "five", {n: r for n, r in moving_arm.rigid(2.0).items() if n != "tilt"})
    return place


@pytest.fixture(autouse=True)
def in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)


def near(parameters: list[dict], joint: str) -> None:
    """Friction is within four standard deviations of the truth."""
    found = {p["name"]: p for p in parameters}
    for name, truth in zip(("c", "tau_f"), TRUTH[joint], strict=True):
        assert abs(found[name]["value"] - truth) < 4.0 * found[name]["std_dev"], (joint, name)


def test_one_joint_of_a_moving_arm(run):
    words = ("fit", "moves", "--urdf", "arm.urdf", "--joint", "lift")
    code, out, err = run(*words, "--save", "lift.json")
    assert code == 0, out + err
    assert "model rigid_joint" in out and "gravity" not in out.partition("model rigid_joint")[2].partition("\n")[0]
    assert "is from arm.urdf; the estimated inertia holds" in out
    assert "--urdf arm.urdf" in next(line for line in out.splitlines() if line.startswith("the same"))
    saved = json.loads(Path("lift.json").read_text())
    near(saved["parameters"], "lift")
    assert any("arm.urdf" in note for note in saved["notes"])


@pytest.mark.long
def test_every_joint_and_several_bags(run):
    code, out, err = run("fit", "moves", "again", "--urdf", "arm.urdf", "--joint", "all", "--json")
    assert code == 0, out + err
    rows = json.loads(out)
    assert [row["joint"] for row in rows] == list(JOINTS)
    for row in rows:
        near(row["parameters"], row["joint"])


@pytest.mark.long
def test_another_recording_that_must_be_predicted_has_its_load(run):
    words = ("fit", "moves", "--joint", "lift", "--model", "rigid_joint", "--validate", "again")
    code, out, err = run(*words, "--urdf", "arm.urdf")
    assert code == 0, out + err
    explained = float(out.partition("R^2 ")[2].split()[0])
    assert explained > 0.99


@pytest.mark.long
def test_a_base_that_is_mounted_otherwise_is_named(run):
    words = ("fit", "moves", "--urdf", "arm.urdf", "--joint", "lift", "--model", "rigid_joint")
    _, out, _ = run(*words, "--base-gravity", "9.81,0,0", "--json")
    found = json.loads(out)
    assert "give --base-gravity 0,0,-9.81 if the base is mounted so" in found["message"]
    rows = {row["name"]: row for row in found["parameters"]}
    for name, truth in (("c", VISCOUS[1]), ("tau_f", COULOMB[1])):  # by the load that is matched, with wide intervals
        assert abs(rows[name]["value"] - truth) < 4.0 * rows[name]["std_dev"]


@pytest.mark.long
def test_a_report_names_the_description(run):
    code, out, err = run("report", "moves", "--urdf", "arm.urdf", "--joint", "lift", "-o", "lift.html")
    assert code == 0, out + err
    assert "is from arm.urdf" in Path("lift.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "words, told",
    [
        (("--urdf", "no.urdf", "--joint", "lift"), "no.urdf: cannot be read"),
        (("--urdf", "arm.urdf", "--joint", "lfit"), "did you mean lift"),
        (("--urdf", "arm.urdf", "--joint", "lift", "--model", "motor_side"), "motor_side takes no load"),
        (("--urdf", "arm.urdf", "--model", "rigid_joint"), "--joint turn, or --joint all"),
        (("--urdf", "arm.urdf", "--joint", "lift", "--base-gravity", "0,0"), "three numbers"),
        (("--urdf", "arm.urdf", "--joint", "lift", "--base-gravity", "down"), "three numbers"),
        (("--base-gravity", "0,0,-9.81", "--joint", "lift"), "give --urdf, too"),
    ],
)
def test_what_does_not_fit_together_is_said(run, words, told):
    code, out, err = run("fit", "moves", *words)
    assert code == 2 and not out and told in err and err.count("\n") == 1, err


def test_a_joint_that_was_not_recorded_is_named(run):
    code, _, err = run("fit", "five", "--urdf", "arm.urdf", "--joint", "lift")
    assert code == 2 and "no recording of tilt, which arm.urdf moves" in err
