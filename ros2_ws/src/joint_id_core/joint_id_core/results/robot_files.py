"""Damping, friction and rotor inertia of joints written into a robot's description: URDF or MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from joint_id_core.errors import JointIdError
from joint_id_core.results.at_link import AtLink

# Attribute of each quantity. A URDF has no place for the inertia of a rotor.
URDF = {"damping": "damping", "friction": "friction"}
MJCF = {"damping": "damping", "friction": "frictionloss", "armature": "armature"}
MOVING = ("revolute", "continuous", "prismatic")


def with_joints(path: Path, kind: str, joints: Mapping[str, Sequence[AtLink]], source: Mapping[str, str]) -> str:
    """Return a URDF or MJCF (`kind`) in which joints have these quantities; what else it holds stays.

    A comment in each joint says value, standard deviation and `source`, and names what has no place in the format.

    Raises:
        JointIdError: the file cannot be read or is of another kind, a joint is not in it or does not move.
    """
    try:
        root = ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()
    except OSError as error:
        raise JointIdError(f"{path}: cannot be read ({error.strerror}): check the path and its permissions") from None
    except ET.ParseError as error:
        raise JointIdError(f"{path}: not XML ({error}): give a URDF or MJCF file; expand a xacro first") from None
    wanted = {"urdf": "robot", "mjcf": "mujoco"}[kind]
    if root.tag != wanted:
        raise JointIdError(f"{path}: its root is <{root.tag}>, that of {kind.upper()} is <{wanted}>: give such a file")
    own = list(root.iter("joint")) if kind == "mjcf" else root.findall("joint")
    elements = {element.get("name", ""): element for element in own}
    for name, quantities in joints.items():
        if name not in elements:
            raise JointIdError(f"{path} has no joint {name!r}: it has {', '.join(filter(None, elements))}; use --joint")
        element = elements[name]
        if kind == "urdf" and element.get("type") not in MOVING:
            raise JointIdError(
                f"{path}: joint {name} is {element.get('type')}: only {', '.join(MOVING)} joints have friction"
            )
        place, attributes = (element, MJCF) if kind == "mjcf" else (_dynamics(element), URDF)
        written = [q for q in quantities if q.name in attributes]
        for quantity in written:
            place.set(attributes[quantity.name], f"{quantity.value:.9g}")
        said = [
            *(q.text for q in written),
            *(f"no place for: {q.text}" for q in quantities if q.name not in attributes),
        ]
        element.insert(0, ET.Comment(f" {source[name]}: {'; '.join(said)} ".replace("--", "- -")))
        element[0].tail = element.text if element.text and element.text.strip() == "" else "\n"
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _dynamics(joint: ET.Element) -> ET.Element:
    """Return the element of a URDF joint that holds damping and friction; make it if there is none."""
    found = joint.find("dynamics")
    if found is None:
        found = ET.SubElement(joint, "dynamics")
        if len(joint) > 1:  # on a line of its own, as the others
            found.tail, joint[-2].tail = joint[-2].tail, joint.text
    return found
