"""`joint-id arm friction-scales`: scales of a UR robot's friction model, for its user to set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from joint_id_core.cli.arm_options import ArmOptions, UrdfArgument, read
from joint_id_core.cli.options import with_group
from joint_id_core.cli.output import Progress
from joint_id_core.cli.outputs import require_apart, require_different
from joint_id_core.text_file import write_text

FILES_HELP = "bags, or tables, with all joints, their currents and target currents"


@with_group("options", ArmOptions)
def friction_scales(
    urdf: UrdfArgument,
    files: Annotated[list[Path], typer.Argument(help=FILES_HELP)],
    options: ArmOptions,
    out: Annotated[
        Optional[Path], typer.Option("--out", "-o", help="file to write (default: stdout)", readable=False)
    ] = None,
) -> None:
    """Offer scales for the friction model of a UR robot's direct torque control. Nothing is sent.

    Each is the friction of the measured current over that of the controller's target current, in the same motion.

    Exit code 0: done; 2: bad input.
    """
    from joint_id_core.arm.friction_scales import friction_scales as found

    require_different(files)
    require_apart({"--out": out}, [urdf, *files, *options.inputs])
    description = options.description(urdf)
    gains, _ = options.gains(description.joints)
    with Progress() as progress:
        progress("reading the recordings")
        records = [read(file, options.part, description) for file in files]
        progress(f"fitting {len(description.joints)} joints twice")
        text = f"{found(description, records, gains)}\n"
    if out is None:
        print(text, end="")
        return
    write_text(out, text, "the scales")
    print(f"{out}: look at it, then set the scales yourself; nothing was sent to a robot")
