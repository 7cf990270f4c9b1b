"""Limits of joints from a URDF, from a file like MoveIt's joint_limits.yaml, and as published for UR robots."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.design.limits import JointLimits
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.rtde.fields import JOINT_NAMES

_TURN = 2.0 * math.pi
# Maximum velocity in deg/s and torque in Nm, from the base on. Source: Universal Robots, user manuals of the e-Series
# 5.8, and "Max. joint torques"; as in Universal_Robots_ROS2_Description, config/*/joint_limits.yaml.
_PUBLISHED = {
    "ur3e": ((180, 180, 180, 360, 360, 360), (56, 56, 28, 12, 12, 12)),
    "ur5e": ((180, 180, 180, 180, 180, 180), (150, 150, 150, 28, 28, 28)),
    "ur10e": ((120, 120, 180, 180, 180, 180), (330, 330, 150, 56, 56, 56)),
}
# keys of joint_limits.yaml: our name, and the key that says whether the limit holds
_KEYS = {
    "min_position": ("lower", "has_position_limits"),
    "max_position": ("upper", "has_position_limits"),
    "max_velocity": ("velocity", "has_velocity_limits"),
    "max_acceleration": ("acceleration", "has_acceleration_limits"),
    "max_jerk": ("jerk", "has_jerk_limits"),
    "max_effort": ("torque", "has_effort_limits"),
}
_KNOWN = (*_KEYS, *sorted({has for _, has in _KEYS.values()}))


def published(robot: str) -> JointLimits:
    """Return the limits that the manufacturer publishes of a robot: ur3e, ur5e or ur10e.

    Joints turn by 360 degrees either way, the elbow by 180, where it would meet the upper arm. Accelerations are not
    published.

    Raises:
        JointIdError: the robot is not known.
    """
    if robot not in _PUBLISHED:
        raise JointIdError(
            f"no limits of a robot {robot!r} are known{close_to(robot, _PUBLISHED)}: known are {', '.join(_PUBLISHED)}"
            "; give a file of limits"
        )
    speed, torque = (np.array(values, dtype=float) for values in _PUBLISHED[robot])
    room = np.array([_TURN / 2.0 if name == "elbow_joint" else _TURN for name in JOINT_NAMES])
    free = JointLimits.none(JOINT_NAMES, f"published limits of {robot}")
    return replace(free, lower=-room, upper=room, velocity=np.radians(speed), torque=torque)


def read_limits(path: str | Path, names: Sequence[str], known: JointLimits | None = None) -> JointLimits:
    """Read limits of joints from a URDF, or from a YAML file like MoveIt's joint_limits.yaml.

    Args:
        path: file; one that ends in .yaml or .yml is read as YAML.
        names: of the joints whose limits are wanted; what the file says of others is left out.
        known: limits of these joints which the file adds to and replaces. A URDF may hold none.

    Raises:
        JointIdError: the file cannot be read or holds no limits of these joints, a key that is not known, a limit that
            is no number, limits that contradict.
    """
    path = Path(path)
    found = _found(path, names[0])
    base = JointLimits.none(names) if known is None else known.of(names)
    if not any(name in found for name in names):
        raise JointIdError(f"{path}: holds no limits of {', '.join(names)}: it has {', '.join(found) or 'none'}")
    parts = {kind: getattr(base, kind).copy() for kind, _ in _KEYS.values()}
    for k, name in enumerate(names):
        for kind, value in found.get(name, {}).items():
            parts[kind][k] = value
    return replace(base, source=str(path), **parts)


def joints_with_limits(path: str | Path, example: str) -> tuple[str, ...]:
    """Return the names of the joints in a file of limits; an error shows how to write one, for the joint `example`.

    Raises:
        JointIdError: as `read_limits`.
    """
    return tuple(_found(Path(path), example))


def _found(path: Path, example: str) -> dict[str, dict[str, float]]:
    """Return the limits of a file by joint."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        limits = "max_position: 1.5, min_position: -1.5, max_velocity: 2.0, max_effort: 50.0"
        raise JointIdError(
            f"{path}: cannot be read ({reason}): give a URDF, or write such a file: joint_limits: {{{example}: "
            f"{{{limits}}}}}"
        ) from None
    return _of_yaml(text, path) if path.suffix.lower() in (".yaml", ".yml") else _of_urdf(text, path)


def _of_urdf(text: str, path: Path) -> dict[str, dict[str, float]]:
    """Return the limits of a URDF by joint."""
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise JointIdError(f"{path}: neither YAML (.yaml) nor XML ({error}): give a URDF or a file of limits") from None
    found = {}
    for joint in root.findall("joint"):
        limit, name, own = joint.find("limit"), joint.get("name", ""), {}
        if joint.get("type") not in ("revolute", "prismatic", "continuous"):
            continue
        if limit is None:
            limit = ET.Element("limit")
        for key, kind in (("lower", "lower"), ("upper", "upper"), ("velocity", "velocity"), ("effort", "torque")):
            if (value := limit.get(key)) is not None and not (kind in ("lower", "upper") and _endless(joint)):
                own[kind] = _number(value, f"{path}: {key} of joint {name}")
        # a URDF has 0 where nobody filled it in
        found[name] = {kind: v for kind, v in own.items() if v != 0.0 or kind in ("lower", "upper")}
    return found


def _endless(joint: ET.Element) -> bool:
    return joint.get("type") == "continuous"


def _of_yaml(text: str, path: Path) -> dict[str, dict[str, float]]:
    """Return the limits of a YAML file by joint."""
    import yaml

    class Loader(yaml.SafeLoader):
        """Knows !degrees and !radians, as ROS's robot descriptions use them."""

    Loader.add_constructor("!degrees", lambda loader, node: math.radians(float(loader.construct_scalar(node))))
    Loader.add_constructor("!radians", lambda loader, node: float(loader.construct_scalar(node)))
    try:
        content = yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, TypeError) as error:
        raise JointIdError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from None
    joints = content.get("joint_limits", content) if isinstance(content, Mapping) else None
    if not isinstance(joints, Mapping) or not all(isinstance(one, Mapping) for one in joints.values()):
        raise JointIdError(f"{path}: holds no limits: write joint_limits: JOINT: max_velocity: 1.0 and so on")
    return {str(name): _entries(one, f"{path}: joint {name}") for name, one in joints.items()}


def _entries(entries: Mapping[Any, Any], where: str) -> dict[str, float]:
    """Return the limits of a joint in a YAML file."""
    if unknown := [str(key) for key in entries if key not in _KNOWN]:
        raise JointIdError(
            f"{where}: unknown key {unknown[0]}{close_to(unknown[0], _KNOWN)}: known are {', '.join(_KNOWN)}"
        )
    found = {}
    for key, (kind, has) in _KEYS.items():
        if key in entries and entries.get(has, True):
            found[kind] = _number(entries[key], f"{where}: {key}")
        elif entries.get(has) is False:
            found[kind] = -math.inf if kind == "lower" else math.inf
        elif entries.get(has) and key not in entries:
            raise JointIdError(f"{where}: {has} is true, but {key} is missing")
    return found


def _number(value: Any, where: str) -> float:
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        found = math.nan
    if math.isnan(found):
        raise JointIdError(f"{where} is {value!r}: give a number in SI units")
    return found
