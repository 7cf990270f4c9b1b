"""`joint-id doctor`: whether this computer has what joint_id needs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from joint_id_core.cli.fit_options import JsonOption
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError


def doctor(
    robot_ip: Annotated[str, typer.Option(help="also ask this UR robot for an answer")] = "",
    port: Annotated[int, typer.Option(help="of the robot's RTDE; 0: the usual one", min=0, max=65535)] = 0,
    json: JsonOption = False,
) -> None:
    """Check Python, libraries, the kernels' cache, ROS 2 with DDS on this computer, and a robot; say what mends it.

    Exit code 0: all that is needed is there; 1: something is wrong.
    """
    from joint_id_core.doctor import checks, table

    if port and not robot_ip:
        raise JointIdError("--port is that of a robot: give --robot-ip, too, or leave it out")

    found = list(checks(robot_ip, port))
    if json:
        print_json({"checks": [asdict(c) for c in found]})
    else:
        print(table(found))
    if any(c.needed and not c.fine for c in found):
        raise typer.Exit(1)
