"""`joint-id watch`: the node `watch` from the command line of joint_id."""

from __future__ import annotations

from typing import Annotated

import typer

from joint_id_ros.options.watch import WatchOptions


def watch(
    port: Annotated[
        int, typer.Option(help="port of the page on 127.0.0.1; 0 takes any that is free")
    ] = WatchOptions.port,
    identifier: Annotated[str, typer.Option(help="name of the identifier that is shown")] = WatchOptions.identifier,
    namespace: Annotated[str, typer.Option(help="of the robot's nodes, such as /left")] = "",
) -> None:
    """Show the running graph on a local page: estimates, alarms, the fit of the newest window, until Ctrl-C."""
    from joint_id_ros.running import run

    remap = ["-r", f"__ns:={namespace}"] if namespace else []
    given = ["-p", f"port:={port}", "-p", f"identifier:={identifier}"]
    raise typer.Exit(run("watch", "WatchNode", ["--ros-args", *given, *remap]))
