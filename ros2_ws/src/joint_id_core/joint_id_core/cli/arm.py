"""`joint-id arm fit`: friction, rotors and inertial parameters of a whole arm."""

from __future__ import annotations

import json as json_text
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.arm.gains import Gains
from joint_id_core.cli.arm_options import ArmOptions, UrdfArgument, read
from joint_id_core.cli.fit_options import JsonOption
from joint_id_core.cli.friction_scales import friction_scales
from joint_id_core.cli.group import complain
from joint_id_core.cli.options import with_group
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.cli.outputs import require_apart, require_different
from joint_id_core.jobs.given import in_order, joints_of, names_in
from joint_id_core.text_file import require_writable, write_text

if TYPE_CHECKING:
    from joint_id_core.arm.payload import Factor

OUT_HELP = "robot to write, with what was estimated: a URDF; or, if it ends in .xml, an MJCF, with rotors; repeatable"
arm = typer.Typer(help="Identify a whole arm: all joints move at once.", no_args_is_help=True, rich_markup_mode=None)


@arm.callback()
def _group() -> None:
    """Identify a whole arm: all joints move at once."""


arm.command("friction-scales")(friction_scales)


@arm.command()
@with_group("options", ArmOptions)
def fit(
    urdf: UrdfArgument,
    files: Annotated[list[Path], typer.Argument(help="bags, or tables, with all joints; several: one fit of all")],
    options: ArmOptions,
    payload: Annotated[
        Optional[list[Path]], typer.Option(help="recording in which the last link carries a payload; repeatable")
    ] = None,
    mass: Annotated[
        Optional[float],
        typer.Option(help="of the payload in kg, if it was weighed: the torque constants are found, too"),
    ] = None,
    validate: Annotated[Optional[Path], typer.Option(help="recording that the fit must predict")] = None,
    save: Annotated[Optional[Path], typer.Option(help="save the result as JSON", readable=False)] = None,
    out: Annotated[Optional[list[Path]], typer.Option("--out", "-o", help=OUT_HELP, readable=False)] = None,
    parameters: Annotated[
        bool, typer.Option("--parameters", help="print the combinations of masses and inertias, too")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Fit viscous and Coulomb friction and the rotor of every joint, and the inertial parameters of the links.

    All torques and inertias scale with the torque constants. A recorded torque is taken as that at the link, or at the
    motor with --set N=RATIO.

    Exit code 0: the torques of all joints are explained and contradict nothing; 1: they are not, or do; 2: bad input.
    """
    from joint_id_core import formats
    from joint_id_core.arm.exported import OF_MUJOCO, exported
    from joint_id_core.arm.fit import fit_arm
    from joint_id_core.arm.written import explained_by
    from joint_id_core.results.robot_files import TOLD

    loaded, outs = payload or [], out or []
    require_different([*files, *loaded])
    inputs = [urdf, *files, *loaded, validate, *options.inputs]
    require_apart(
        {"--save": save} | {f"--out ({k + 1})" if k else "--out": path for k, path in enumerate(outs)}, inputs
    )
    for path, what in ((save, "the result"), *((path, "the description") for path in outs)):
        if path is not None:
            require_writable(path, what)
    description = options.description(urdf)
    gains, spread = options.gains(description.joints)
    with Progress() as progress:
        progress("reading the recordings")
        records = [read(file, options.part, description) for file in files]
        carried = [read(file, options.part, description) for file in loaded]
        held_out = None if validate is None else read(validate, options.whole, description)
        progress(f"fitting {len(description.joints)} joints")
        found = fit_arm(description, records, gains, held_out, carried, mass)
    if json:
        print_json(found.to_dict())
    else:
        ordered = in_order(description.source, names_in(description.joints, joints_of(files[0], options.part.mapping)))
        for text in (*formats.taken(files[0], None, options.part.mapping), *([ordered] if ordered else [])):
            print(text)
        print(found)
        if parameters:
            print(f"\n{found.combinations}\n")
        for text in _constants(found.factors, gains) if found.factors else ():
            print(f"  {text}")
        if spread and not found.factors:
            print(f"  all values scale with the torque constants, which are known to {spread}")
    if save is not None:
        write_text(save, json_text.dumps(found.to_dict(), indent=1), "the result")
    source = f"{TOLD}arm fit of {', '.join(file.name for file in files)}"
    for path in outs:
        write_text(path, exported(found, description, path, source), "the description")
        if not json:
            print(f"  {path}: {urdf} with what was estimated")
        if held_out is not None and not json:
            again = explained_by(path, description, held_out, _corrected(gains, found.factors))
            rotors = "" if path.suffix.lower() in OF_MUJOCO else ", without the other rotors,"
            print(f"  {path}, read again{rotors} predicts {validate} with R^2 {' '.join(f'{r:.4f}' for r in again)}")
    if not found.converged:
        complain(f"{found.status.value}: {found.message}")
        raise typer.Exit(1)


def _corrected(gains: Gains, factors: Sequence[Factor]) -> dict[str, dict[str, float]]:
    """Return the gains times the factors that were found."""
    share = {factor.joint: factor.value for factor in factors}
    return {name: {drive: share.get(name, 1.0) * gain for drive, gain in own.items()} for name, own in gains.items()}


def _constants(factors: Sequence[Factor], gains: Gains) -> list[str]:
    """Return options that give the torque constants that were found, to be pasted; none without currents."""
    known = [(f, gains[f.joint]) for f in factors if f.known and "current" in gains[f.joint]]
    return [
        f"--set {f.joint}.k_t={f.value * gain['current'] / gain['torque']:.4g}+-{100.0 * f.std_dev / f.value:.2g}%"
        for f, gain in known
    ]
