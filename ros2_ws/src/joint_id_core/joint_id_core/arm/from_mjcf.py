"""A robot's description for MuJoCo (MJCF) as a URDF: bodies and joints, no shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.arm.urdf import UNBOUNDED
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

DIGITS = ".12g"
BASE = "world"


def is_mjcf(text: str) -> bool:
    """Return whether a text is an MJCF."""
    try:
        return ET.fromstring(text).tag == "mujoco"
    except ET.ParseError:
        return False


def urdf_of(path: Path) -> str:
    """Return the URDF of an MJCF file. Meshes are not needed where a body has an <inertial>.

    MuJoCo itself reads the file: defaults, units, included files and shapes with a density mean what they mean there.

    Raises:
        JointIdError: MuJoCo is not installed or cannot read the file, a joint is no hinge or slide or shares its body,
            or joints depend on each other.
    """
    model = _compiled(path)
    if model.neq:
        raise JointIdError(
            f"{path}: it has constraints between bodies or joints (<equality>), which no URDF describes: leave them out"
        )
    root = ET.Element("robot", {"name": path.stem})
    ET.SubElement(root, "link", {"name": BASE})
    names = {0: BASE}
    anchors = np.zeros((model.nbody, 3))  # origin of the link of a body, in the frame of the body
    for k in range(1, model.nbody):
        names[k] = model.body(k).name or f"body_{k}"
        joint = _joint_of(model, k, path)
        if joint is not None:
            anchors[k] = joint.pos
        above = int(model.body_parentid[k])
        turn = _matrix(model.body_quat[k])
        place = model.body_pos[k] + turn @ anchors[k] - anchors[above]
        _add_link(root, model, k, names[k], anchors[k])
        _add_joint(root, joint, names[above], names[k], place, turn)
    ET.indent(root)
    return f"{ET.tostring(root, encoding='unicode')}\n"


def _compiled(path: Path) -> Any:
    """Return the model of MuJoCo, without shapes where they are not needed."""
    try:
        import mujoco
    except ModuleNotFoundError:
        raise JointIdError(f"{path}: an MJCF needs MuJoCo, which is not installed: pip install mujoco") from None
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        for body in spec.bodies:
            for shape in body.geoms if body.explicitinertial else ():
                spec.delete(shape)
        for shown in (*spec.geoms, *spec.sites):
            shown.material = ""  # what is only seen may lack its files
        used = {geom.meshname for geom in spec.geoms}
        unused = [mesh for mesh in spec.meshes if mesh.name not in used]
        for kind in ("skins", "materials", "textures", "keys", "sensors", "actuators", "tendons", "excludes", "pairs"):
            unused += getattr(spec, kind)
        for element in unused:
            spec.delete(element)
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
        raise JointIdError(f"{path}: MuJoCo cannot read it ({why}): correct it, or give a URDF") from None


def _joint_of(model: Any, body: int, path: Path) -> Any:
    """Return the joint of a body; None if it is fixed to its parent."""
    count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    if not count:
        return None
    joint, name = model.joint(first), model.body(body).name
    if count > 1:
        raise JointIdError(f"{path}: body {name!r} has {count} joints: give each a body of its own")
    if int(model.jnt_type[first]) < 2:  # free or ball
        raise JointIdError(f"{path}: joint {joint.name!r} is no hinge or slide: fix the body, or leave it out")
    if not joint.name:
        raise JointIdError(f"{path}: the joint of body {name!r} has no name: joints are found by name")
    return joint


def _add_link(root: ET.Element, model: Any, body: int, name: str, anchor: Array) -> None:
    link = ET.SubElement(root, "link", {"name": name})
    mass = float(model.body_mass[body])
    if mass == 0.0:
        return
    turn = _matrix(model.body_iquat[body])
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", {"xyz": _listed(model.body_ipos[body] - anchor), "rpy": "0 0 0"})
    ET.SubElement(inertial, "mass", {"value": format(mass, DIGITS)})
    at = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {entry: format(inertia[k], DIGITS) for entry, k in at.items()})


def _add_joint(root: ET.Element, joint: Any, parent: str, child: str, place: Array, turn: Array) -> None:
    kind = "fixed" if joint is None else "prismatic" if int(joint.type[0]) == 2 else "continuous"
    if kind == "continuous" and joint.limited[0]:
        kind = "revolute"
    element = ET.SubElement(root, "joint", {"name": f"{child}_fixed" if joint is None else joint.name, "type": kind})
    ET.SubElement(element, "origin", {"xyz": _listed(place), "rpy": _listed(_angles(turn))})
    ET.SubElement(element, "parent", {"link": parent})
    ET.SubElement(element, "child", {"link": child})
    if joint is None:
        return
    ET.SubElement(element, "axis", {"xyz": _listed(joint.axis)})
    told = {"damping": joint.damping[0], "friction": joint.frictionloss[0]}
    ET.SubElement(element, "dynamics", {name: format(float(value), DIGITS) for name, value in told.items()})
    if joint.limited[0]:
        low, high = (format(float(end), DIGITS) for end in joint.range)
        ET.SubElement(element, "limit", UNBOUNDED | {"lower": low, "upper": high})


def _matrix(quaternion: Array) -> Array:
    """Return the rotation of a unit quaternion (w, x, y, z), shape (3, 3)."""
    w, *v = quaternion.tolist()
    x = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + 2.0 * w * x + 2.0 * x @ x)


def _angles(turn: Array) -> Array:
    """Return roll, pitch and yaw of a rotation, as a URDF has them: about fixed axes x, y, z."""
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0]))
    if np.hypot(turn[0, 0], turn[1, 0]) < 1e-9:  # roll and yaw turn about the same axis: all is roll
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _listed(values: Sequence[float] | Array) -> str:
    return " ".join(format(float(value), DIGITS) for value in values)
