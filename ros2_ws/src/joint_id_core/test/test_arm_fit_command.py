"""`joint-id arm fit`: what it prints, saves and writes, and what it refuses."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording

from . import moving_arm
from .moving_arm import CARRYING, COULOMB, JOINTS, MASS, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

SECONDS = 12.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A bag with currents at the motor, one with torques, and the description."""
    place = tmp_path_factory.mktemp("arm")
    (place / "arm.urdf").write_text(URDF)
    (place / "robot.yaml").write_text(
        "/**/identifier:\n  ros__parameters:\n    set:\n      - N=100\n"
        + "".join(f"      - {name}.k_t=0.1+-{5 + k}%\n" for k, name in enumerate(JOINTS))
    )
    record = moving_arm.rigid(SECONDS, 0)
    formats.write_bag(place / "torques", record)
    currents = {
        n: Recording(r.time, {"link_position": r["link_position"], "current": r["torque"] / 10.0}, joint=n)
        for n, r in record.items()
    }
    formats.write_bag(place / "currents", currents)
    return place


@pytest.fixture
def here(folder, monkeypatch, run):
    monkeypatch.chdir(folder)
    return run


def test_the_command_prints_saves_and_writes_a_description(here):
    Path("new.urdf").write_text("an earlier one")
    words = ("--save", "arm.json", "--out", "new.urdf", "--validate", "torques")
    code, out, err = here("arm", "fit", "arm.urdf", "torques", *words)
    assert code == 0, out + err
    assert "arm of 6 joints: converged" in out and "turn, armature: beside the inertia of its links" in out
    assert "  new.urdf: arm.urdf with what was estimated\n" in out
    saved = json.loads(Path("arm.json").read_text())
    assert saved["recordings"] == ["torques"]
    assert [j["name"] for j in saved["joints"]] == list(JOINTS) and len(saved["parameters"]) == 40
    root = ET.parse("new.urdf").getroot()
    for k, name in enumerate(JOINTS):
        row = saved["joints"][k]
        found = root.find(f"joint[@name='{name}']/dynamics")
        assert found is not None
        assert float(found.get("damping", "nan")) == pytest.approx(row["damping"]["value"], rel=1e-6)
        assert float(found.get("friction", "nan")) == pytest.approx(row["friction"]["value"], rel=1e-6)
        assert abs(row["damping"]["value"] - VISCOUS[k]) < 4.0 * row["damping"]["std_dev"]
    masses = [float(root.find(f"link[@name='{link['name']}']/inertial/mass").get("value")) for link in saved["links"]]
    for link, mass in zip(saved["links"][:-1], masses, strict=False):  # a tool is fixed to the last one
        assert mass == pytest.approx(link["found"]["mass"], rel=1e-6) and len(link["found"]["inertia"]) == 6
    code, _, err = here("report", "arm.json")
    assert code == 2 and "not an estimate" in err and "joint_id arm estimate" in err


def test_joints_of_other_names_are_told_with_the_names_that_were_recorded(here):
    Path("left.urdf").write_text(URDF.replace(f'"{JOINTS[0]}"', f'"left_{JOINTS[0]}"'))
    code, _, err = here("arm", "fit", "left.urdf", "torques")
    assert (
        code == 2 and f"torques: no recording of left_{JOINTS[0]}, which left.urdf moves; it holds {JOINTS[0]}, " in err
    )
    assert "same names in a copy of the description" in err


def test_the_combinations_of_masses_and_inertias_are_a_table(here):
    code, out, err = here("arm", "fit", "arm.urdf", "torques", "--parameters")
    assert code == 0, out + err
    rows = [line for line in out.splitlines() if " ± " in line and " of " in line and "Izz of turn" in line]
    value, sigma, described = (float(w) for w in rows[0].split()[:4] if w != "±")
    assert 0.0 < sigma < 0.05 * value and described < value  # the rotor is not in the description
    assert "estimated" in rows[0] and "rotor of turn" in rows[0]
    assert len([line for line in out.splitlines() if " estimated " in line or " prior " in line]) >= 35


@pytest.mark.long
def test_the_command_writes_an_mjcf_and_tells_what_the_files_predict(here):
    words = ("--out", "robot.urdf", "--out", "robot.xml", "--validate", "torques")
    code, out, err = here("arm", "fit", "arm.urdf", "torques", *words)
    assert code == 0, out + err
    assert "column  as described" in out
    for name, least in (("robot.urdf", 0.5), ("robot.xml", 0.999)):  # a URDF has the first rotor only
        told = next(line for line in out.splitlines() if name in line and "R^2" in line)
        shares = [float(word) for word in told.split("R^2 ")[1].split()]
        assert len(shares) == len(JOINTS) and min(shares) > least, told
    joints = list(ET.parse("robot.xml").getroot().iter("joint"))
    assert [joint.get("name") for joint in joints] == list(JOINTS)
    assert all(float(joint.get("armature", "nan")) > 0.0 for joint in joints)
    code, _, err = here("arm", "fit", "arm.urdf", "torques", "--out", "a.xml", "--out", "a.xml")
    assert code == 2 and "--out (2) a.xml would overwrite a file that --out writes" in err


@pytest.mark.parametrize(
    "gains", [("--robot", "robot.yaml"), pytest.param(("--set", "k_t=0.1", "--set", "N=100"), marks=pytest.mark.long)]
)
def test_currents_need_torque_constants(here, gains):
    code, out, err = here("arm", "fit", "arm.urdf", "currents", *gains, "--json")
    assert code == 0, out + err
    rows = json.loads(out)["joints"]
    for row, truth in zip(rows, COULOMB, strict=True):
        assert abs(row["friction"]["value"] - truth) < 4.0 * row["friction"]["std_dev"]
    code, out, err = here("arm", "fit", "arm.urdf", "currents")
    assert code == 2 and "has a current: give its torque constant" in err


def test_the_command_weighs_a_payload_and_tells_torque_constants(here):
    formats.write_bag(
        "carrying",
        {
            n: Recording(r.time, {"link_position": r["link_position"], "current": r["torque"] / 12.0}, joint=n)
            for n, r in moving_arm.rigid(SECONDS, 2, CARRYING).items()
        },
    )
    formats.write_bag(
        "free",
        {
            n: Recording(r.time, {"link_position": r["link_position"], "current": r["torque"] / 12.0}, joint=n)
            for n, r in moving_arm.rigid(SECONDS, 1).items()
        },
    )
    words = ("arm", "fit", "arm.urdf", "free", "--robot", "robot.yaml", "--payload", "carrying")
    code, out, err = here(*words)
    assert code == 0 and "payload on plate: 2.0" in out, out + err  # with constants that are a fifth too small
    code, out, err = here(*words, "--mass", MASS)
    assert code == 0, out + err
    given = [line.split("k_t=")[1] for line in out.splitlines() if ".k_t=" in line]
    assert len(given) == len(JOINTS)
    for text in given:
        value, sigma = text.rstrip("%").split("+-")
        assert abs(float(value) - 0.12) < 4.0 * 0.12 * float(sigma) / 100.0
    code, _, err = here("arm", "fit", "arm.urdf", "free", "--robot", "robot.yaml", "--payload", "free")
    assert code == 2 and "given twice" in err


def test_how_far_torque_constants_are_known_is_told(here):
    code, out, _ = here("arm", "fit", "arm.urdf", "currents", "--robot", "robot.yaml")
    assert code == 0 and "known to 5 to 10 %" in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("torques", "--set", "J=1"), "of an arm, N and k_t can be set"),
        (("torques", "--set", "lifft.k_t=1"), "no such joint"),
        (("torques", "--set", "N=0"), "not 0"),
        (("torques", "torques"), "is given twice"),
        (("torques", "--save", "torques"), "would overwrite a file that is read"),
        (("torques", "--out", "arm.urdf"), "would overwrite a file that is read"),
        (("no_bag",), "no such file"),
    ],
)
def test_bad_input_ends_in_one_line(here, words, told):
    code, out, err = here("arm", "fit", "arm.urdf", *words)
    assert code == 2 and not out and told in err and err.count("\n") == 1, err


def numbered(path, record):
    """Write a table whose columns have numbers, as many controllers log."""
    channels = {"q": "link_position", "tau": "torque"}
    columns = {f"{word}{k}": r[own] for word, own in channels.items() for k, r in enumerate(record.values(), start=1)}
    time = next(iter(record.values())).time
    rows = zip(time.tolist(), *(c.tolist() for c in columns.values()), strict=True)
    path.write_text("\n".join([",".join(["t", *columns]), *(",".join(map(repr, row)) for row in rows)]) + "\n")


@pytest.mark.long
def test_numbered_joints_are_those_of_the_description_in_its_order(here):
    numbered(Path("table.csv"), moving_arm.rigid(SECONDS, 0))
    values = {}
    for log in ("torques", "table.csv"):
        code, out, err = here("arm", "fit", "arm.urdf", log, "--json")
        assert code == 0, out + err
        values[log] = [(j["name"], round(j["friction"]["value"], 9)) for j in json.loads(out)["joints"]]
    assert values["table.csv"] == values["torques"]
    words = ("--urdf", "arm.urdf", "--model", "rigid_joint", "--json")
    for log, joint in (("torques", JOINTS[1]), ("table.csv", "joint_2")):
        _, out, _ = here("fit", log, "--joint", joint, *words)
        values[log] = [(p["name"], p["value"], p["verdict"]) for p in json.loads(out)["parameters"]]
    assert values["table.csv"] == values["torques"]
    _, out, _ = here("fit", "table.csv", "--joint", "joint_2", *words[:-1], "--save", "second.json")
    told = f"The joints are taken in the order of arm.urdf: joint_1 = {JOINTS[0]}, joint_2 = {JOINTS[1]}, "
    assert told in out and told in here("arm", "fit", "arm.urdf", "table.csv")[1]
    assert json.loads(Path("second.json").read_text())["joint"] == JOINTS[1]  # by which `export` finds it


GRIPPER = """
  <joint name="grip" type="prismatic"><parent link="{last}"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
  <joint name="other" type="prismatic"><parent link="{last}"/><child link="finger_2"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.04" effort="1" velocity="1"/><mimic joint="grip"/></joint>
  <link name="finger"><inertial><mass value="0.01"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger_2"><inertial><mass value="0.01"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""


def test_joints_that_stand_still_need_no_recording(here):
    last = ET.fromstring(URDF).findall("joint")[-1].find("child").get("link")
    Path("gripper.urdf").write_text(URDF.replace("</robot>", GRIPPER.format(last=last)))
    code, _, err = here("arm", "fit", "gripper.urdf", "torques")
    assert code == 2 and "other follows another joint" in err and "--still grip" in err
    numbered(Path("table.csv"), moving_arm.rigid(SECONDS, 0))
    code, out, err = here(
        "arm", "fit", "gripper.urdf", "table.csv", "--still", "grip", "--out", "written.urdf", "--validate", "torques"
    )
    assert code == 0, out + err
    assert "arm of 6 joints: converged" in out
    kinds = {j.get("name"): j.get("type") for j in ET.parse("written.urdf").getroot().findall("joint")}
    assert kinds["grip"] == kinds["other"] == "fixed"
    code, _, err = here("arm", "fit", "gripper.urdf", "table.csv", "--still", "gripp")
    assert code == 2 and "--still gripp: gripper.urdf has no such joint (did you mean grip?)" in err
    code, _, err = here("fit", "table.csv", "--still", "grip")
    assert code == 2 and "--still is for the robot's description: give --urdf" in err
