"""`joint-id export`: what was identified, for a simulator."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.errors import JointIdError
from joint_id_core.text_file import write_text

if TYPE_CHECKING:
    from joint_id_core.results.at_link import AtLink
    from joint_id_core.results.estimate import Estimate

JOINT_HELP = (
    "name of the joint in the description, one for each estimate, in their order (default: that of the estimate)"
)
PARAMS_HELP = "parameter file of the identifier node, which starts with these values"
BENT, FRICTION = "eyring", ("damping", "friction")  # a law whose slope at rest is not that of a motion
ALL_HELP = "also what is not known to half of its value, and estimates that are not good ones"


def export(
    estimates: Annotated[list[Path], typer.Argument(help="estimates, from fit --save, one a joint")],
    urdf: Annotated[Optional[Path], typer.Option(help="robot description to take over, with these joints")] = None,
    mjcf: Annotated[Optional[Path], typer.Option(help="the same for MuJoCo")] = None,
    ros_params: Annotated[bool, typer.Option("--ros-params", help=PARAMS_HELP)] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="a table, which is the default")] = False,
    out: Annotated[
        Optional[Path], typer.Option("--out", "-o", help="file to write (default: CSV on stdout)", readable=False)
    ] = None,
    joint: Annotated[Optional[list[str]], typer.Option(help=JOINT_HELP)] = None,
    all_: Annotated[bool, typer.Option("--all", help=ALL_HELP)] = False,
) -> None:
    """Write damping, Coulomb friction and rotor inertia at the link, with their uncertainty, for a simulator.

    Only what is known is written, unless --all is given; the rest is named on stderr. With --ros-params, write all
    parameters of the model for the identifier node.
    """
    from joint_id_core.cli.group import complain
    from joint_id_core.results.at_link import at_link
    from joint_id_core.results.estimate import Estimate
    from joint_id_core.results.robot_files import TOLD, with_joints
    from joint_id_core.results.ros_params import parameter_file

    if (urdf is not None) + (mjcf is not None) + ros_params + as_csv > 1:
        raise JointIdError("--urdf, --mjcf, --ros-params and --csv exclude each other: run the command once for each")
    template, kind = (urdf, "urdf") if urdf is not None else (mjcf, "mjcf")
    if template is not None and out is None:
        raise JointIdError(f"--{kind} needs a file to write: give --out FILE")
    if out is not None and out.exists():
        raise JointIdError(f"{out} exists already: remove it or choose another name")
    if joint is not None and len(joint) != len(estimates):
        raise JointIdError(f"{len(joint)} names and {len(estimates)} estimates: give one --joint for each")
    found: dict[str, list[AtLink]] = {}
    loaded: dict[str, Estimate] = {}
    source: dict[str, str] = {}
    beside: list[str] = []
    for k, path in enumerate(estimates):
        estimate = Estimate.load(path)
        name = joint[k] if joint is not None else estimate.joint
        if not name:
            raise JointIdError(f"{path} is of a joint without a name: give it with --joint NAME")
        if not name.isprintable():
            raise JointIdError(f"{path}: the name of joint {name!r} cannot be printed: give another with --joint NAME")
        if name in found:
            raise JointIdError(f"two estimates are of joint {name}: give one")
        if not estimate.converged and not all_:
            raise JointIdError(f"{path}: {estimate.status.value}, not a good estimate: leave it out, or add --all")
        loaded[name], every = estimate, at_link(estimate)
        if _law(estimate) == BENT:
            every = [q for q in every if q.name not in FRICTION]
        found[name] = [q for q in every if q.known or (all_ and math.isfinite(q.value) and math.isfinite(q.std_dev))]
        source[name] = f"{TOLD}{path.name}, {estimate.model} by {estimate.estimator}"
        if ros_params:
            continue
        left_out = (f"left out, not known: {q.text}" for q in every if q not in found[name])
        beside += [f"{name}: {text}" for text in (*left_out, *_beside(estimate))]
    if ros_params:
        text = parameter_file(loaded, source)
    else:
        text = with_joints(template, kind, found, source) if template is not None else _csv(found, source)
    for told in beside:
        complain(told)
    if out is None:
        print(text, end="")
        return
    write_text(out, text, "the export")
    print(f"{out}: what was identified of {', '.join(found)}")


def _beside(estimate: Estimate) -> list[str]:
    """Return what an estimate tells that damping and Coulomb friction do not hold."""
    law, said = _law(estimate), list[str]()
    if law == BENT:
        said.append(
            f"its friction law is {law}, whose slope falls with speed: no damping is that (fit coulomb_viscous)"
        )
    elif law != "coulomb_viscous":
        said.append(f"its friction law is {law}: only its Coulomb level and its viscous slope are exported")
    if "J" in estimate.values:
        said.append("J is of rotor and link together, so no rotor inertia is exported")
    return said


def _law(estimate: Estimate) -> str:
    return str(estimate.model_options.get("friction", "coulomb_viscous"))


def _csv(found: dict[str, list[AtLink]], source: dict[str, str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["joint", "quantity", "value", "std_dev", "unit", "formula", "source"])
    for name, quantities in found.items():
        for q in quantities:
            writer.writerow([name, q.name, f"{q.value:.9g}", f"{q.std_dev:.3g}", q.unit, q.formula, source[name]])
    return text.getvalue()
