"""`joint-id robot-emulator`: an emulated robot controller to try things out and to test clients."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.assignments import vector
from joint_id_core.cli.fit_options import BaseGravityOption
from joint_id_core.emulator.faults import COMMANDS, usage
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import FIELDS, JOINTS, PORT, register_type

if TYPE_CHECKING:
    from joint_id_core.arm.description import Description

EPILOG = "\b\nCommands, one a line on standard input:\n" + "\n".join(
    f"  {usage(c):<20}{c.meaning}" for c in COMMANDS.values()
)


def robot_emulator(
    host: Annotated[str, typer.Option(help="address to listen at")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="TCP port; 0: any that is free")] = PORT,
    robot: Annotated[str, typer.Option(help="ur3e, ur5e or ur10e: sizes of the joints")] = "ur3e",
    version: Annotated[str, typer.Option(help="of the controller; it decides which fields there are")] = "5.13.0",
    without: Annotated[Optional[list[str]], typer.Option(help="field that the controller does not have")] = None,
    slow_start: Annotated[float, typer.Option(help="s after power-up in which it listens but answers nothing")] = 0.0,
    seed: Annotated[int, typer.Option(help="of noise and faults")] = 0,
    moving: Annotated[str, typer.Option(help="joints that move: all, none, or numbers from 0 to 5 as 0,2")] = "all",
    amplitude: Annotated[float, typer.Option(help="peak of the motion in rad")] = 0.3,
    urdf: Annotated[
        Optional[Path],
        typer.Option(help="description of an arm of six joints: gravity, and links that act on each other"),
    ] = None,
    base_gravity: BaseGravityOption = None,
    socket: Annotated[
        Optional[Path],
        typer.Option(help="file to make for commands of other programs of this computer", readable=False),
    ] = None,
    truth: Annotated[
        Optional[Path], typer.Option(help="YAML file to write the true parameters to", readable=False)
    ] = None,
) -> None:
    """Emulate a robot controller on the network: RTDE at 500 Hz, six simulated joints, faults on demand.

    Prints `ready on HOST:PORT` when it listens. As on a test rig with additional motor encoders,
    output_double_register_24..29 hold the motor positions in rad and 30..35 the motor velocities in rad/s, both at the
    motor shaft. The joints and their parameters are fictitious.
    """
    numbers = _version(version)
    which = _joints(moving)
    for name in without or ():
        if name not in FIELDS and register_type(name) is None:
            raise JointIdError(f"--without {name}: no such field, known are {', '.join(FIELDS)} and registers")
    if not (math.isfinite(slow_start) and slow_start >= 0.0):
        raise JointIdError(f"--slow-start {slow_start:g}: give a time in s, 0 or more")
    if seed < 0:
        raise JointIdError(f"--seed {seed}: give a number from 0 on")
    if not 0.0 <= amplitude <= 3.0:
        raise JointIdError(f"--amplitude {amplitude:g}: give rad from 0 to 3")

    from joint_id_core.design.limit_files import published
    from joint_id_core.emulator.emulator import Emulator
    from joint_id_core.emulator.robots import build_joints, with_links

    joints, description = build_joints(robot), None
    if urdf is not None:
        description = _description(urdf, base_gravity)
        joints = with_links(joints, description.joints)
    elif base_gravity is not None:
        raise JointIdError("--base-gravity needs the description of the robot: give --urdf, too")
    limits = replace(published(robot), names=tuple(joint.name for joint in joints))
    emulator = Emulator(
        joints, which, amplitude, numbers, without or (), seed, host, port, slow_start, description, limits, socket
    )
    if truth is not None:
        import yaml

        try:
            truth.write_text(yaml.safe_dump({j.name: j.values for j in joints}, sort_keys=False))
        except OSError as error:
            raise JointIdError(f"--truth {truth}: {error.strerror}: choose a file that can be written") from None
    emulator.run()


def _description(urdf: Path, base_gravity: str | None) -> Description:
    """Read the description of the links.

    Raises:
        JointIdError: it cannot be read, or is not that of an arm of six joints.
    """
    from joint_id_core.arm.description import GRAVITY, Description
    from joint_id_core.emulator.links import require_six_joints

    description = Description.read(urdf, GRAVITY if base_gravity is None else vector(base_gravity, "--base-gravity"))
    require_six_joints(description)
    return description


def _version(text: str) -> tuple[int, ...]:
    """Parse a version to (major, minor, bugfix, build)."""
    parts = text.split(".")
    if not 2 <= len(parts) <= 4 or not all(p.isdecimal() and len(p) < 10 for p in parts):
        raise JointIdError(f"--version {text}: write it as 5.13.0")
    return (*map(int, parts), *(0,) * (4 - len(parts)))


def _joints(text: str) -> frozenset[int]:
    """Parse the indices of the joints that move."""
    if text in ("all", "none"):
        return frozenset(range(JOINTS if text == "all" else 0))
    parts = text.split(",")
    if not all(p.strip().isdecimal() and int(p) < JOINTS for p in parts):
        raise JointIdError(f"--moving {text}: write all, none, or numbers from 0 to {JOINTS - 1} as 0,2")
    return frozenset(map(int, parts))
