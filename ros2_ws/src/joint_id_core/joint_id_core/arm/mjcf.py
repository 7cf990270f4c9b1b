"""A robot for MuJoCo (MJCF) from its description and a fit: bodies, joints, damping, friction and rotors, no shapes.

A URDF has no place for the inertia of a rotor. What is fixed to a link is one body with it, as where MuJoCo reads a
URDF itself.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from joint_id_core.arm.description import Description
from joint_id_core.arm.links import Links
from joint_id_core.results.at_link import AtLink
from joint_id_core.results.robot_files import MJCF

DIGITS = ".12g"
KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}


def mjcf(text: str, description: Description, links: Links, joints: Mapping[str, Sequence[AtLink]], source: str) -> str:
    """Return the MJCF.

    Args:
        text: the URDF of the description, which tells limits, and damping and friction that were not found.
        description: of it.
        links: what was found.
        joints: quantities of each joint that are known.
        source: of them, for a comment.
    """
    import pinocchio

    urdf, model = ET.fromstring(text), description.model
    root = ET.Element("mujoco", {"model": urdf.get("name", "robot")})
    root.append(ET.Comment(_safe(f" {source}; bodies and joints of {description.source}, without shapes ")))
    ET.SubElement(root, "compiler", {"angle": "radian"})
    ET.SubElement(root, "option", {"gravity": _listed(model.gravity.linear)})
    bodies = {0: ET.SubElement(root, "worldbody")}
    for link in sorted(links.links, key=lambda link: int(model.getJointId(link.joint))):
        k = model.getJointId(link.joint)
        place = model.jointPlacements[k]
        *around, upright = pinocchio.Quaternion(place.rotation).coeffs().tolist()
        body = ET.SubElement(bodies[model.parents[k]], "body", {
            "name": link.name, "pos": _listed(place.translation), "quat": _listed([upright, *around]),
        })  # fmt: skip
        bodies[k] = body
        xx, xy, yy, xz, yz, zz = link.found.inertia
        ET.SubElement(body, "inertial", {
            "pos": _listed(link.found.centre), "mass": format(link.found.mass, DIGITS),
            "fullinertia": _listed([xx, yy, zz, xy, xz, yz]),
        })  # fmt: skip
        known = joints.get(link.joint, ())
        if known:
            body.append(ET.Comment(_safe(f" {'; '.join(q.text for q in known)} ")))
        ET.SubElement(body, "joint", _joint(urdf, link.joint) | {MJCF[q.name]: format(q.value, DIGITS) for q in known})
    ET.indent(root)
    return f"{ET.tostring(root, encoding='unicode')}\n"


def _joint(urdf: ET.Element, name: str) -> dict[str, str]:
    """Return what a URDF says of a joint, in the words of an MJCF."""
    joint = next(joint for joint in urdf.findall("joint") if joint.get("name") == name)
    kind, axis = joint.get("type", ""), joint.find("axis")
    found = {"name": name, "type": KINDS[kind], "axis": "1 0 0" if axis is None else axis.get("xyz", "1 0 0")}
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    if limit is not None and kind != "continuous":
        low, high = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
        if low < high:
            found["range"] = _listed([low, high])
    if dynamics is not None:
        found |= {MJCF[name]: value for name in ("damping", "friction") if (value := dynamics.get(name)) is not None}
    return found


def _listed(values: Sequence[float]) -> str:
    return " ".join(format(float(value), DIGITS) for value in values)


def _safe(text: str) -> str:
    """Return a text that a comment can hold: "--" would end it."""
    return re.sub("-(?=-)", "- ", text)
