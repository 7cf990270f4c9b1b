"""A fit of an arm as a robot's description: URDF, or MJCF with rotors."""

from __future__ import annotations

from pathlib import Path

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.mjcf import mjcf
from joint_id_core.arm.urdf_bodies import with_bodies
from joint_id_core.results.robot_files import text_with_joints

OF_MUJOCO = (".xml", ".mjcf")  # endings of files


def exported(found: ArmEstimate, description: Description, out: Path, source: str) -> str:
    """Return the description with what was estimated: bodies of links, damping, friction, and rotors.

    Args:
        found: the fit.
        description: of the robot, from a file.
        out: the file that will be written; an MJCF if it ends so, else a URDF, which holds the first rotor only.
        source: of the values, for comments.
    """
    known = found.at_link()
    sources = dict.fromkeys(known, source)
    own = {n: q for n, q in known.items() if q}
    text = text_with_joints(description.text, Path(description.source), "urdf", own, sources)
    if out.suffix.lower() not in OF_MUJOCO:
        return with_bodies(text, found.links, source)
    return mjcf(text, description, found.links, known, source)
