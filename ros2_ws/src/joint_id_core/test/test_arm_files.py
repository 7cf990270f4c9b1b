"""A fit of an arm written as URDF and MJCF: Pinocchio and MuJoCo move it as the fit says."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, ROTOR, URDF, VISCOUS
from .quick import first_quick
from .test_arm_links import wrong

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the exported files are loaded with mujoco, which is not installed")

import mujoco

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.exported import exported
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.pseudo_inertia import parameters_of
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.written import explained_by

GAINS = {name: {"torque": 1.0} for name in JOINTS}
MOTION = moving_arm.at(np.linspace(0.0, 10.0, 40), 7)
# The joint moves an empty link, a turned one is fixed to it; and the tool is heavier than the plate that holds it.
TURNED = '<joint name="glue" type="fixed"><parent link="hand"/><child link="palm"/><origin rpy="0.4 -0.3 2"/></joint>'
FIXED = URDF.replace('<link name="hand">', '<link name="hand"/><link name="palm">').replace(
    "</robot>", f"{TURNED}</robot>"
)
BASES = {
    "a fifth wrong": wrong(0),
    "masses in fixed links": wrong(1, FIXED.replace('mass value="0.8"', 'mass value="1.0"')),
    "an inertia that no body has": re.sub('(?<=ixx="0.02" iyy=")[^"]*', "0.09", URDF),
}


@pytest.fixture(scope="module")
def records():
    return [moving_arm.rigid(15.0, seed) for seed in (0, 1)], moving_arm.rigid(8.0, 9)


@pytest.fixture(scope="module", params=first_quick(BASES))
def written(request, records, tmp_path_factory) -> tuple[Path, ArmEstimate, Description]:
    assert BASES[request.param] != URDF
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(BASES[request.param])
    description = Description.read(folder / "arm.urdf")
    found = fit_arm(description, records[0], GAINS, records[1])
    for name in ("new.urdf", "new.xml"):
        text = exported(found, description, folder / name, "joint_id, a log--of mine")
        (folder / name).write_text(text)
    return folder, found, description


def torques(found: ArmEstimate, description: Description) -> np.ndarray:
    """Torques without Coulomb friction by the equations of the fit, shape (T, 6)."""
    regressor = Regressor(description)
    bodies = np.array([parameters_of(link.found.pseudo_inertia) for link in found.links.links])
    base = regressor.composition @ np.concatenate([np.zeros(len(JOINTS)), bodies.ravel()])
    rotors = np.array([link.rotor for link in found.links.links])
    damping = np.array([j.damping.value for j in found.joints])
    rigid = regressor.rows(MOTION.q, MOTION.dq, MOTION.ddq)[0] @ base
    return np.asarray(rigid + rotors * MOTION.ddq + damping * MOTION.dq)


def of_mujoco(text: str, armature: np.ndarray | None = None) -> np.ndarray:
    """Torques without Coulomb friction by MuJoCo, shape (T, 6)."""
    model = mujoco.MjModel.from_xml_string(text.replace('<robot name="arm">', moving_arm.MUJOCO))
    model.dof_frictionloss[:] = 0.0
    model.dof_armature[:] += 0.0 if armature is None else armature
    data, found = mujoco.MjData(model), np.empty_like(MOTION.q)
    for k in range(len(found)):
        data.qpos[:], data.qvel[:], data.qacc[:] = MOTION.q[k], MOTION.dq[k], MOTION.ddq[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def test_the_mjcf_moves_as_the_fit_says(written):
    folder, found, description = written
    text = (folder / "new.xml").read_text()
    np.testing.assert_allclose(of_mujoco(text), torques(found, description), rtol=1e-7, atol=1e-7)
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_allclose(model.dof_frictionloss, [j.friction.value for j in found.joints], rtol=1e-6)
    for values, truth in ((model.dof_damping, VISCOUS), (model.dof_frictionloss, COULOMB), (model.dof_armature, ROTOR)):
        np.testing.assert_allclose(values, truth, rtol=0.12)
    assert [model.joint(k).name for k in range(model.njnt)] == list(JOINTS)
    assert "log- -of mine" in text and "without shapes" in text


def test_so_does_the_urdf_with_the_rotors_but_that_of_the_first_joint_which_it_holds(written):
    folder, found, description = written
    again = Description.read(folder / "new.urdf")
    bodies = [parameters_of(link.found.pseudo_inertia) for link in found.links.links]
    np.testing.assert_allclose(Regressor(again).bodies[1:], bodies[1:], rtol=1e-7, atol=1e-9)
    rotors = np.array([link.rotor for link in found.links.links])
    assert rotors[0] > 0.1
    rotors[0] = 0.0
    moved = of_mujoco((folder / "new.urdf").read_text(), rotors)
    np.testing.assert_allclose(moved, torques(found, description), rtol=1e-7, atol=1e-7)
    for element in ET.parse(folder / "new.urdf").getroot().iter("inertial"):
        assert float(element.find("mass").get("value")) > 0.0


def test_the_files_predict_a_recording_as_the_fit_does(written, records):
    folder, found, description = written
    whole = explained_by(folder / "new.xml", description, records[1], GAINS)
    for j, again in zip(found.joints, whole, strict=True):
        assert again > j.held_out - 0.001 and j.held_out > 0.99
    without = explained_by(folder / "new.urdf", description, records[1], GAINS)  # and without rotors, but the first
    assert without[0] == pytest.approx(whole[0], abs=1e-4)
    assert all(a < b for a, b in zip(without[1:], whole[1:], strict=True))
    before = explained_by(folder / "arm.urdf", description, records[1], GAINS)
    assert all(a < b for a, b in zip(before, without, strict=True))


def test_all_else_stays(written):
    folder, _, _ = written
    before, after = (ET.parse(folder / name).getroot() for name in ("arm.urdf", "new.urdf"))
    for root in (before, after):
        for element in list(root.iter()):
            for part in element.findall("inertial") + element.findall("dynamics"):
                element.remove(part)
    assert re.sub(rb"\s", b"", ET.tostring(before)) == re.sub(rb"\s", b"", ET.tostring(after))


def test_what_is_not_estimated_is_not_written(tmp_path, records):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    description = Description.read(path)
    found = fit_arm(description, records[0], GAINS)
    lift = found.joints[1]
    unknown = {
        name: replace(getattr(lift, name), verdict=Verdict.PRIOR) for name in ("damping", "friction", "armature")
    }
    less = replace(found, joints=(found.joints[0], replace(lift, **unknown), *found.joints[2:]))
    for name, wanted in (("new.urdf", ("damping", "friction")), ("new.xml", ("damping", "frictionloss", "armature"))):
        root = ET.fromstring(exported(less, description, tmp_path / name, "a fit"))
        for joint in root.iter("joint"):
            place = joint if name.endswith("xml") else joint.find("dynamics")
            there = [] if place is None else [word for word in wanted if word in place.attrib]
            moving = joint.get("name") in JOINTS
            assert there == (list(wanted) if moving and joint.get("name") != "lift" else []), joint.get("name")
