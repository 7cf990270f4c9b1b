"""Damping, friction and rotor inertia of joints written into a robot's description: URDF or MJCF."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from joint_id_core.errors import JointIdError, close_to
from joint_id_core.results.at_link import AtLink

# Attribute of each quantity. A URDF has no place for the inertia of a rotor.
URDF = {"damping": "damping", "friction": "friction"}
MJCF = {"damping": "damping", "friction": "frictionloss", "armature": "armature"}
LINEAR = {"Nm s/rad": "N s/m", "Nm": "N", "kg m^2": "kg"}  # units of a joint that slides
TOLD = "joint_id, "  # begins what comments of ours say
MOVING = {"urdf": ("revolute", "continuous", "prismatic"), "mjcf": ("hinge", "slide")}  # joints of one coordinate


def with_joints(path: Path, kind: str, joints: Mapping[str, Sequence[AtLink]], source: Mapping[str, str]) -> str:
    """Return a URDF or MJCF file (`kind`) in which joints have these quantities; see `text_with_joints`.

    Raises:
        JointIdError: the file cannot be read; and as for `text_with_joints`.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise JointIdError(f"{path}: cannot be read ({error.strerror}): check the path and its permissions") from None
    return text_with_joints(text, path, kind, joints, source)


def text_with_joints(
    text: str | bytes, path: Path, kind: str, joints: Mapping[str, Sequence[AtLink]], source: Mapping[str, str]
) -> str:
    """Return the text of a URDF or MJCF (`kind`) in which joints have these quantities; what else it holds stays.

    A comment in each joint says value, standard deviation and `source`, and names what has no place in the format.
    `path` is the file that the text is of, for messages.

    Raises:
        JointIdError: the text is of another kind or a xacro, or a joint is not in it, there twice, or not one that
            moves by itself.
    """
    try:
        root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    except ET.ParseError as error:
        raise JointIdError(f"{path}: not XML ({error}): give a URDF or MJCF file; expand a xacro first") from None
    wanted = {"urdf": "robot", "mjcf": "mujoco"}[kind]
    if root.tag != wanted:
        raise JointIdError(f"{path}: its root is <{root.tag}>, that of {kind.upper()} is <{wanted}>: give such a file")
    elements = _joints(path, root, kind)
    for name, quantities in joints.items():
        if name not in elements:
            raise JointIdError(
                f"{path} has no joint {name!r}{close_to(name, elements)}: it has {', '.join(elements)}; use --joint"
            )
        element = elements[name]
        _check_moving(path, element, kind)
        place, attributes = (element, MJCF) if kind == "mjcf" else (_dynamics(element), URDF)
        written = [q for q in quantities if q.name in attributes]
        for quantity in written:
            place.set(attributes[quantity.name], f"{quantity.value:.9g}")
        if element.get("type") in ("prismatic", "slide"):
            quantities = [replace(q, unit=LINEAR.get(q.unit, q.unit)) for q in quantities]
        said = [f"{'' if q.name in attributes else 'no place for: '}{q.text}" for q in quantities]
        said.sort(key=lambda text: text.startswith("no place"))
        _remove_told(element)
        told = re.sub("-(?=-)", "- ", f" {source[name]}: {'; '.join(said)} ")  # "--" ends a comment
        element.insert(0, ET.Comment(told))
        element[0].tail = element.text if element.text and element.text.strip() == "" else "\n"
    return as_text(root, text)


def as_text(root: ET.Element, before: str | bytes) -> str:
    """Return a changed description as text, below the comments that stand above it in the text of `before`."""
    parser: Any = ET.XMLPullParser(("start", "comment"))
    parser.feed(before)
    comments: list[str] = []
    for event, element in parser.read_events():
        if event == "start":
            break
        comments.append(f"<!--{element.text}-->\n")
    return f'<?xml version="1.0"?>\n{"".join(comments)}{ET.tostring(root, encoding="unicode")}\n'


def _remove_told(joint: ET.Element) -> None:
    """Remove the comments of an earlier export, whose values are replaced."""
    for child in [c for c in joint if (c.text or "").strip().startswith(TOLD)]:
        joint.remove(child)


def _joints(path: Path, root: ET.Element, kind: str) -> dict[str, ET.Element]:
    """Return the joints of a description by name.

    Raises:
        JointIdError: there are none, two have the same name, or the file is a xacro.
    """
    if kind == "urdf":
        own = root.findall("joint")
    else:  # defaults and constraints have elements of that name, too
        inside = (e for world in root.iter("worldbody") for e in world.iter())
        own = [e for e in inside if e.tag in ("joint", "freejoint")]
    names = Counter(name for e in own if (name := e.get("name")))
    parts = [e.get("file", "") for e in root.iter("include")] if kind == "mjcf" else []
    if not names and any(parts):
        raise JointIdError(f"{path} has no joint, it includes {', '.join(parts)}: give the file that has the joints")
    if not names:
        raise JointIdError(
            f"{path} has no joint with a name: if it is a xacro, expand it first (xacro {path.name} > robot.{kind})"
        )
    macros = [e for e in root.iter() if isinstance(e.tag, str) and e.tag.partition("}")[0].endswith("xacro")]
    if macros or any("${" in name for name in names):
        raise JointIdError(
            f"{path} is a xacro: expand it first (xacro {path.name} > robot.{kind}), and give the result"
        )
    if twice := [name for name, count in names.items() if count > 1]:
        raise JointIdError(f"{path} has two joints of the name {twice[0]}: give each a name of its own")
    return {name: e for e in own if (name := e.get("name"))}


def _check_moving(path: Path, joint: ET.Element, kind: str) -> None:
    """Check that a joint moves, in one coordinate, and by itself.

    Raises:
        JointIdError: it does not.
    """
    name, moves = joint.get("name"), joint.get("type", "hinge" if kind == "mjcf" else "of no type")
    moves = "free" if joint.tag == "freejoint" else moves
    if moves not in MOVING[kind]:
        raise JointIdError(
            f"{path}: joint {name} is {moves}: only {', '.join(MOVING[kind])} joints can have these values"
        )
    mimic = joint.find("mimic")
    if kind == "urdf" and mimic is not None:
        led = mimic.get("joint")
        raise JointIdError(f"{path}: joint {name} follows joint {led} (<mimic>): identify {led}, and export that")


def _dynamics(joint: ET.Element) -> ET.Element:
    """Return the element of a URDF joint that holds damping and friction; make it if there is none."""
    found = joint.find("dynamics")
    if found is None:
        found = ET.SubElement(joint, "dynamics")
        if len(joint) > 1:  # on a line of its own, as the others
            found.tail, joint[-2].tail = joint[-2].tail, joint.text
    return found
