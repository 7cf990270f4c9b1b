"""A description for MuJoCo (MJCF) is read as what MuJoCo takes it for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from joint_id_core.errors import JointIdError

pytest.importorskip("mujoco", reason="an MJCF needs MuJoCo")
pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")

import mujoco

from joint_id_core.arm.description import Description

INERTIAL = '<inertial pos="0.01 0.1 0" mass="3" diaginertia="0.1 0.1 0.05" quat="0.9 0.1 0.2 0.1"/>'
MESHES = '<asset><mesh name="shell" file="nowhere.stl"/><texture name="t" type="2d" file="nowhere.png"/></asset>'
SHELL = '<geom type="mesh" mesh="shell"/>'
# Degrees, defaults, a turned base, joints beside the origin of their body, a body fixed to another one, a shape with a
# density in place of an <inertial>, a slide, and much that no load depends on.
ARM = f"""<mujoco><compiler angle="degree"/>{MESHES}
<default><default class="turning"><joint axis="0 0.6 0.8" range="-100 200" damping="2" frictionloss="1"/></default>
</default>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="base" pos="0 0 0.1" euler="10 20 30">{INERTIAL}{SHELL}
<body name="upper" pos="0 0 0.2" quat="0.5 0.5 0.5 0.5">{INERTIAL}{SHELL}
<joint class="turning" name="one" pos="0.1 0.2 0.3"/>
<body name="plate" pos="1 0 0" euler="0 90 40"><geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.4" mass="2"/>
<body name="rail" pos="0 0.1 0.3"><joint name="two" type="slide" axis="0 1 0" pos="0 0 0.02"/>{INERTIAL}
<body name="last" pos="0 0.1 0.3"><joint name="three" axis="1 0 0"/><geom size="0.1" density="500"/></body>
</body></body></body></body></worldbody>
<actuator><motor joint="one"/></actuator><sensor><jointpos joint="one"/></sensor>
<keyframe><key qpos="0.1 0.2 0.3"/></keyframe></mujoco>"""


def written(folder: Path, text: str) -> Path:
    (folder / "arm.xml").write_text(text)
    return folder / "arm.xml"


def torques(text: str, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Inverse dynamics by MuJoCo, without friction, shape (T, joints)."""
    model = mujoco.MjModel.from_xml_string(text.replace(MESHES, "").replace(SHELL, ""))
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def test_its_load_is_that_of_mujoco(tmp_path):
    description = Description.read(written(tmp_path, ARM))
    assert description.joints == ("one", "two", "three") and description.turning.tolist() == [True, False, True]
    assert description.link_of("one") == "upper"
    q, dq, ddq = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 30, 3))
    load = description.loads(q, dq, ddq)
    np.testing.assert_allclose(load.torque + load.inertia * ddq, torques(ARM, q, dq, ddq), rtol=1e-9, atol=1e-9)


def test_limits_damping_and_friction_are_kept(tmp_path):
    text = Description.read(written(tmp_path, ARM)).text
    assert 'damping="2" friction="1"' in text and 'type="revolute"' in text and 'type="continuous"' in text
    assert f'lower="{np.deg2rad(-100):.12g}" upper="{np.deg2rad(200):.12g}"' in text


BODY = '<mujoco><worldbody><body name="a">{}<geom size="0.1"/></body></worldbody>{}</mujoco>'
HINGE = '<joint name="j"/>'
REFUSED = {
    "not valid": (BODY.format('<joint axis="0 0"/>', ""), "MuJoCo cannot read it"),
    "free": (BODY.format('<freejoint name="f"/>', ""), "joint 'f' is no hinge or slide: fix the body"),
    "ball": (BODY.format('<joint name="b" type="ball"/>', ""), "joint 'b' is no hinge or slide"),
    "two": (BODY.format(HINGE + '<joint name="k" axis="1 0 0"/>', ""), "body 'a' has 2 joints"),
    "no name": (BODY.format("<joint/>", ""), "the joint of body 'a' has no name"),
    "none": (BODY.format("", ""), "no joint moves"),
    "tied": (
        BODY.format(HINGE + '<body name="b"><joint name="k"/><geom size="0.1"/></body>',
                    '<equality><joint joint1="j" joint2="k"/></equality>'), "<equality>",
    ),
    "mesh": (
        '<mujoco><asset><mesh name="m" file="nowhere.stl"/></asset><worldbody><body name="a"><joint name="j"/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>', "nowhere.stl",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "told"), REFUSED.values(), ids=list(REFUSED))
def test_what_no_urdf_can_say_is_refused(tmp_path, text, told):
    with pytest.raises(JointIdError) as error:
        Description.read(written(tmp_path, text))
    assert told in str(error.value) and str(error.value).startswith(str(tmp_path / "arm.xml"))


def test_without_mujoco_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(JointIdError, match="an MJCF needs MuJoCo, which is not installed: pip install mujoco"):
        Description.read(written(tmp_path, ARM))
