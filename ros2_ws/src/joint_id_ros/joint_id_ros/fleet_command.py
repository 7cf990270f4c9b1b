"""`joint-id fleet`: the node `fleet` from the command line of joint_id."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from joint_id_ros.options.fleet import FleetOptions


def fleet(
    robots: Annotated[Path, typer.Argument(help="YAML file with the robots")],
    processes: Annotated[
        int, typer.Option(help="processes that share the robots; about one a core is best")
    ] = FleetOptions.processes,
) -> None:
    """Identify the joints of many robots, each in its namespace, until Ctrl-C.

    The file has a list `robots`: for each its `name` and the arguments of robot.launch.py, such as robot_ip and
    params_file. What stands under `all` holds for every robot that does not say otherwise.
    """
    from joint_id_ros.running import run

    given = ["-p", f"robots:={robots}", "-p", f"processes:={processes}"]
    raise typer.Exit(run("fleet", ["--ros-args", *given]))
