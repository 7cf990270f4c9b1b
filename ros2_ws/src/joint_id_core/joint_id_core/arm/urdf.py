"""The text of a URDF: checked, without what is not needed, and made into a model of Pinocchio."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from joint_id_core.errors import JointIdError, close_to

TURNING = ("revolute", "continuous")
MOVING = (*TURNING, "prismatic")
UNBOUNDED = {"lower": "-1e3", "upper": "1e3", "effort": "1e6", "velocity": "1e6"}


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: position = factor * that of `joint` + offset."""

    joint: str
    factor: float
    offset: float


def parsed(text: str, source: str) -> ET.Element:
    """Return the links and joints of a URDF, without what is not needed."""
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise JointIdError(f"{source}: not XML ({error}): give a URDF; expand a xacro first") from None
    if root.tag != "robot":
        raise JointIdError(f"{source}: its root is <{root.tag}>, that of a URDF is <robot>: give a URDF")
    if any("xacro" in element.tag for element in root.iter()):
        raise JointIdError(f"{source}: a xacro, which stands for a URDF: expand it first (xacro {source} > robot.urdf)")
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
        for part in element.findall("visual") + element.findall("collision"):
            element.remove(part)
    links = {link.get("name", "") for link in root.findall("link")}
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in (*MOVING, "fixed"):
            raise JointIdError(
                f"{source}: joint {name!r} is {kind or 'of no type'}: known are {', '.join(MOVING)} and fixed: make it "
                "fixed in a copy of the description if it stands still"
            )
        for end in ("parent", "child"):
            if end_of(joint, end) not in links:
                raise JointIdError(
                    f"{source}: joint {name!r} has the {end} {end_of(joint, end)!r}, which is no link: correct it"
                )
    if not any(joint.get("type") in MOVING for joint in root.findall("joint")):
        raise JointIdError(f"{source}: no joint moves: give the description of the robot")
    return root


def end_of(joint: ET.Element, end: str) -> str:
    """Return the name of the parent or child link of a joint."""
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def mimics_of(root: ET.Element, source: str) -> Mapping[str, Mimic]:
    """Return the joints that follow another one."""
    names = {joint.get("name", "") for joint in root.findall("joint")}
    found = {}
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is None or joint.get("type") not in MOVING:
            continue
        name, leader = joint.get("name", ""), mimic.get("joint", "")
        try:
            found[name] = Mimic(leader, float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0")))
        except ValueError as error:
            raise JointIdError(f"{source}: mimic of joint {name!r}: {error}: correct it") from None
        if leader not in names:
            raise JointIdError(f"{source}: joint {name!r} follows {leader!r}, which is no joint: correct it")
    for name, one in found.items():
        if one.joint in found:
            raise JointIdError(f"{source}: joint {name!r} follows {one.joint!r}, which follows another one: correct it")
    return found


def with_still(text: str, still: Collection[str], source: str) -> str:
    """Return a URDF in which joints that stand still, at 0, are fixed, and those that follow one of them.

    Raises:
        JointIdError: it has no such joint.
    """
    if not still:
        return text
    root = parsed(text, source)  # says what is wrong
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for name in still:
        if name not in joints:
            raise JointIdError(f"--still {name}: {source} has no such joint{close_to(name, joints)}")
    followers = {name for name, mimic in mimics_of(root, source).items() if mimic.joint in still}
    whole = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    for joint in whole.findall("joint"):
        if joint.get("name") in {*still, *followers}:
            joint.set("type", "fixed")
            for part in joint.findall("mimic"):
                joint.remove(part)
    return ET.tostring(whole, encoding="unicode")


def loaded_pinocchio() -> Any:
    """Return the module Pinocchio; to load it takes up to a second.

    Raises:
        JointIdError: it is not installed.
    """
    try:
        import pinocchio
    except ModuleNotFoundError:
        raise JointIdError(
            "a robot's description needs Pinocchio, which is not installed: pip install pin, "
            "or apt install ros-jazzy-pinocchio"
        ) from None
    return pinocchio


def built(root: ET.Element, source: str) -> Any:
    """Return the model of Pinocchio: every joint has one coordinate, and no limits."""
    pinocchio = loaded_pinocchio()
    for joint in root.findall("joint"):
        for part in joint.findall("mimic") + joint.findall("limit") + joint.findall("safety_controller"):
            joint.remove(part)
        if joint.get("type") in TURNING:
            joint.set("type", "revolute")
        if joint.get("type") in MOVING:
            joint.append(ET.Element("limit", UNBOUNDED))
    try:
        return pinocchio.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        why = " ".join(str(error).split())
        raise JointIdError(f"{source}: not a valid URDF ({why}): check it with check_urdf") from None
