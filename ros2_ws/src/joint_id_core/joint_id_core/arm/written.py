"""How well a description that was written predicts a recording: by the numbers in the file, read again."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, equations
from joint_id_core.arm.exported import OF_MUJOCO
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.links import Body
from joint_id_core.arm.pseudo_inertia import parameters_of
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.rests import Left, explained
from joint_id_core.data.recording import Array, Recording


def explained_by(
    path: Path, description: Description, recording: Mapping[str, Recording], gains: Gains
) -> tuple[float, ...]:
    """Return by joint the share of the torque, below 8 Hz and in motion, that a written file explains.

    Args:
        path: a file with the text of `exported`.
        description: from which it was made.
        recording, gains: as for `fit_arm`.

    Raises:
        JointIdError: see `equations`.
    """
    regressor = Regressor(description)
    bodies, joints = _mjcf(path, regressor) if path.suffix.lower() in OF_MUJOCO else _urdf(path, regressor)
    base = regressor.composition @ np.concatenate([joints[0], bodies.ravel()])
    values = np.concatenate([base, np.zeros(PAYLOAD), *joints[1:]])
    friction = Friction.from_values(regressor, values)
    part = friction.added(equations(regressor, recording, gains, description.source))
    values = np.append(values, np.zeros(part.columns.shape[2] - len(values)))  # of what no file holds
    return tuple(explained([Left.of(part, friction, values)]).tolist())


def _urdf(path: Path, regressor: Regressor) -> tuple[Array, Array]:
    """Return bodies (n, 10), and rotors, damping and friction (3, n), of a URDF; rotors are 0."""
    joints = {joint.get("name"): joint.find("dynamics") for joint in ET.parse(path).getroot().findall("joint")}
    values = np.zeros((3, len(regressor.joints)))
    for k, name in enumerate(regressor.joints):
        if (dynamics := joints[name]) is not None:
            values[1:, k] = [float(dynamics.get(q, "0")) for q in ("damping", "friction")]
    return Regressor(Description.read(path)).bodies, values


def _mjcf(path: Path, regressor: Regressor) -> tuple[Array, Array]:
    """Return bodies (n, 10), and rotors, damping and friction (3, n), of an MJCF that `exported` made."""
    bodies, values = np.zeros((len(regressor.joints), 10)), np.zeros((3, len(regressor.joints)))
    for body in ET.parse(path).getroot().iter("body"):
        joint, inertial = body.find("joint"), body.find("inertial")
        assert joint is not None and inertial is not None
        k = regressor.joints.index(joint.get("name", ""))
        values[:, k] = [float(joint.get(q, "0")) for q in ("armature", "damping", "frictionloss")]
        x, y, z = map(float, inertial.get("pos", "").split())
        xx, yy, zz, xy, xz, yz = map(float, inertial.get("fullinertia", "").split())
        found = Body(float(inertial.get("mass", "")), (x, y, z), (xx, xy, yy, xz, yz, zz))
        bodies[k] = parameters_of(found.pseudo_inertia)
    return bodies, values
