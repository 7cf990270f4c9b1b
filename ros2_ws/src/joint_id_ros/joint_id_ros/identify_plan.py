"""The plan of the node `identify`, in a process of its own: a motion, what it is to show, and whether it may be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rclpy.serialization import serialize_message

from joint_id_core.cli.design_joint import design_of_joint
from joint_id_core.cli.fit_options import parameter_settings
from joint_id_core.cli.motion_options import MotionOptions
from joint_id_core.design.design import Design
from joint_id_core.design.files import read_trajectory, write
from joint_id_core.design.limit_files import published, read_limits
from joint_id_core.design.limits import violations
from joint_id_core.design.sequence import one_after_other
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_ros.child_process import Tell
from joint_id_ros.identify_request import Request
from joint_id_ros.trajectories import to_message


@dataclass(frozen=True)
class Plan:
    """A motion with what it is to show, and the bytes of its JointTrajectory, so that sending it takes no time."""

    design: Design
    message: bytes


def plan(tell: Tell, request: Request, positions: Mapping[str, float], file: Path) -> Plan:
    """Return the motion of a request, and write its trajectory to a file.

    Args:
        tell: called with the progress.
        request: what is to be identified.
        positions: where the joints of the robot are now, in rad: a planned motion begins there.
        file: to write, .csv.

    Raises:
        JointIdError: it cannot be read or planned; it breaks limits that are known; it does not move a joint that is to
            be identified, or moves one that the robot does not have.
    """
    request.job(file, "", None, None)  # wrong words are said before anything moves
    design = _given(tell, request) if request.trajectory else _planned(tell, request, positions)
    if strange := [joint for joint in design.trajectory.names if joint not in positions]:
        raise JointIdError(f"the motion is for {', '.join(strange)}, but link_states has {', '.join(positions)}")
    write(design.trajectory, file)
    return Plan(design, serialize_message(to_message(design.trajectory)))


def _given(tell: Tell, request: Request) -> Design:
    """Return the motion of a file, with what it is to show where that can be told."""
    tell(0.0, f"reading {request.trajectory}")
    trajectory = read_trajectory(request.trajectory)
    if missing := [joint for joint in request.joints if joint not in trajectory.names]:
        raise JointIdError(
            f"{request.trajectory} does not move {', '.join(missing)}: it moves {', '.join(trajectory.names)}"
        )
    _require_within(request, trajectory)
    if not (request.model and (request.robot or request.limits)) or request.urdf:
        return Design(trajectory, ())
    joints = request.joints or trajectory.names
    tell(0.1, "telling what it will show")
    try:
        rows = [row for joint in joints for row in _design(request, joint, None).expected]
    except JointIdError as error:
        return Design(trajectory, (), (f"what the motion will show is not known: {error}",))
    return Design(trajectory, tuple(rows))


def _require_within(request: Request, trajectory: Trajectory) -> None:
    """Raise JointIdError if a trajectory breaks the limits that are published of the robot or given in a file."""
    try:
        known = published(Path(request.robot).stem).of(trajectory.names)
    except JointIdError:  # another robot
        known = None
    if request.limits:
        known = read_limits(request.limits, trajectory.names, known)
    if known is not None and (broken := violations(trajectory, known)):
        raise JointIdError(f"{request.trajectory} breaks a limit: {'; '.join(broken)}")


def _planned(tell: Tell, request: Request, positions: Mapping[str, float]) -> Design:
    """Return motions that are designed for the joints, one after the other."""
    joints = request.joints
    if not joints:
        raise JointIdError("name the joints that a motion is planned for, or give a trajectory")
    if strange := [joint for joint in joints if joint not in positions]:
        raise JointIdError(f"link_states has no joint {strange[0]!r}: it has {', '.join(positions)}")
    if len(set(joints)) < len(joints):
        raise JointIdError(f"joints {', '.join(joints)}: name each joint once")
    found = []
    for k, joint in enumerate(joints):
        tell(k / len(joints), f"designing a motion of {joint}")
        found.append(_design(request, joint, positions[joint]))
    return one_after_other(found)


def _design(request: Request, joint: str, home: float | None) -> Design:
    """Return the design of a motion that begins at home in rad, or of the motion that is given."""
    motion = None if home is not None else Path(request.trajectory)
    options = {"model": request.model} if request.model else {}
    asked = MotionOptions(
        robot=request.robot or None,
        limits=Path(request.limits) if request.limits else None,
        time=request.duration or MotionOptions.time,
        home=None if home is None else repr(home),
        reach=request.reach,
        motion=motion,
    )
    return design_of_joint(joint, options, parameter_settings(list(request.set), None, None), asked, "sigma")
