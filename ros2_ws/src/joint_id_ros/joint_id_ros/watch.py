"""`joint-id watch`: the node `watch` from the command line of joint_id."""

from __future__ import annotations

from typing import Annotated

import typer

from joint_id_core.errors import JointIdError
from joint_id_ros.options.watch import WatchOptions


def watch(
    port: Annotated[
        int, typer.Option(help="port of the page on 127.0.0.1; 0 takes any that is free")
    ] = WatchOptions.port,
    identifier: Annotated[str, typer.Option(help="name of the identifier that is shown")] = WatchOptions.identifier,
    namespace: Annotated[str, typer.Option(help="of the robot's nodes, such as /left")] = "",
    fleet: Annotated[bool, typer.Option("--fleet", help="all robots of the graph on one page")] = False,
) -> None:
    """Show the running graph on a local page: estimates, alarms, the fit of the newest window, until Ctrl-C."""
    from joint_id_ros.running import run

    if fleet:
        if namespace or identifier != WatchOptions.identifier:
            raise JointIdError("--fleet shows all robots: leave --namespace and --identifier out")
        raise typer.Exit(run("watch_fleet", ["--ros-args", "-p", f"port:={port}"]))
    remap = ["-r", f"__ns:={namespace}"] if namespace else []
    given = ["-p", f"port:={port}", "-p", f"identifier:={identifier}"]
    raise typer.Exit(run("watch", ["--ros-args", *given, *remap]))
