"""Options of `joint-id design` that a motion of one joint and of an arm have in common, and what is done with it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.cli.outputs import require_apart
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.design.design import Design

OUT_HELP = "file to write: .csv, .yaml (JointTrajectory) or .script (URScript); repeatable"
ROBOT_HELP = "limits as published of ur3e, ur5e or ur10e; --joint: also set, fix and free of its parameter file"
LIMITS_HELP = "limits: YAML as MoveIt's joint_limits.yaml, or a URDF"
HOME_HELP = "pose at start and end, rad; --arm: Q1,Q2,... (default: the middle of the limits)"
FOR_HELP = "what to show: of --joint parameters, of --arm kinds of them (default: all that are estimated)"
WAYPOINTS_HELP = (
    "go through these poses, there and back, along straight lines in joint space, which must be free: CSV, a column a "
    "joint, rad or (deg)"
)
MOTION_HELP = "search nothing, tell what this motion shows (.csv or .yaml as --out writes it)"


@dataclass(frozen=True)
class MotionOptions:
    """What is asked of the motion, and where it goes."""

    robot: Annotated[Optional[str], typer.Option(help=ROBOT_HELP)] = None
    limits: Annotated[Optional[Path], typer.Option(help=LIMITS_HELP)] = None
    time: Annotated[float, typer.Option(help="length of the motion, s")] = 20.0
    rate: Annotated[float, typer.Option(help="samples a second, of the motion and of its recording")] = 500.0
    home: Annotated[Optional[str], typer.Option(help=HOME_HELP)] = None
    reach: Annotated[Optional[float], typer.Option(help="how far a joint may go from home, rad (default: 1)")] = None
    for_: Annotated[Optional[str], typer.Option("--for", metavar="A,B,...", help=FOR_HELP)] = None
    waypoints: Annotated[Optional[Path], typer.Option(help=WAYPOINTS_HELP)] = None
    motion: Annotated[Optional[Path], typer.Option(help=MOTION_HELP)] = None
    out: Annotated[Optional[list[Path]], typer.Option("--out", "-o", help=OUT_HELP, readable=False)] = None
    plot: Annotated[Optional[Path], typer.Option(help="save a picture of the motion", readable=False)] = None

    @property
    def shown(self) -> tuple[str, ...]:
        """What the motion shall show; empty means all."""
        return tuple(part.strip() for part in (self.for_ or "").split(",") if part.strip())

    def require_one_motion(self) -> None:
        """Check that nothing says otherwise where the motion goes than the waypoints do.

        Raises:
            JointIdError: another option does.
        """
        others = {"--motion": self.motion, "--home": self.home, "--reach": self.reach}
        if self.waypoints is not None and (other := [name for name, given in others.items() if given is not None]):
            raise JointIdError(f"--waypoints and {other[0]} both say where the motion goes: leave one of them out")

    def require_writable(self, inputs: Iterable[Path | None]) -> None:
        """Check, before a long search, what will be written.

        Raises:
            JointIdError: an unknown kind of file, a file that is read too, a file that exists, a file or
                picture that cannot be written.
        """
        from joint_id_core.design.files import kind_of
        from joint_id_core.text_file import require_writable as require_text

        for path in self.out or ():
            kind_of(path)
        outputs = {**{f"--out {path}": path for path in self.out or ()}, "--plot": self.plot}
        require_apart(outputs, [self.limits, self.motion, self.waypoints, *inputs])
        for path in self.out or ():
            if path.is_file():  # it may be a recording: both are often called motion.csv
                raise JointIdError(f"{path} exists already: remove it or choose another name")
            require_text(path, "the trajectory")
        if self.plot is not None:
            from joint_id_core.results.plot import require_writable

            require_writable(self.plot)

    def require_program(self, names: Sequence[str], rate: float) -> None:
        """Check that a motion of these joints, at this rate in Hz, can be written as a URScript, if one is wanted.

        Raises:
            JointIdError: it cannot.
        """
        from joint_id_core.design.files import kind_of
        from joint_id_core.design.urscript import require_ur_robot

        if any(kind_of(path) == "URScript" for path in self.out or ()):
            require_ur_robot(names, rate)

    def written(self, found: Design) -> Design:
        """Write and plot the motion, and return the design."""
        from joint_id_core.design.files import write

        for path in self.out or ():
            write(found.trajectory, path, found.notes)
        if self.plot is not None:
            from joint_id_core.design.plot import save

            save(self.plot, found.trajectory)
        return found
