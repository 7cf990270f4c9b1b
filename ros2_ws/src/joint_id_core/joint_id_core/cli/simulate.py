"""`joint-id simulate`: simulate a recording of a model with known parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from joint_id_core.assignments import numbers_by_name
from joint_id_core.cli.fit_options import JsonOption, SetOption
from joint_id_core.cli.options import completed, with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.errors import JointIdError
from joint_id_core.models import MODELS
from joint_id_core.models.options import ModelOptions

OTHERS = (".mat", ".txt", ".tsv", ".gz", ".json", ".mcap", ".db3")  # files that are not written


@with_options("model_options", (ModelOptions,), only=("actuation", "friction", "gravity", "kinematic_error"))
def simulate(
    model_options: dict[str, Any],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="what to write: a .csv file, or else a bag directory", readable=False)
    ],
    model: Annotated[
        Optional[str], typer.Argument(help=f"one of {', '.join(MODELS)}", autocompletion=completed(tuple(MODELS)))
    ] = None,
    same_model: Annotated[
        Optional[str],
        typer.Option("--model", help="the model, if it is not the argument", autocompletion=completed(tuple(MODELS))),
    ] = None,
    duration: Annotated[float, typer.Option(help="length in s")] = 6.0,
    rate: Annotated[float, typer.Option(help="samples a second")] = 500.0,
    seed: Annotated[int, typer.Option(help="of the noise")] = 0,
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="sensors of a UR robot, or exact values")] = True,
    set_: SetOption = None,
    joint: Annotated[Optional[str], typer.Option(help="name of the joint in the bag (default: joint)")] = None,
    json: JsonOption = False,
) -> None:
    """Simulate a joint with known parameters and write the readings of its sensors.

    Models with a voltage input get voltage steps; the others follow a multisine of the link position.
    """
    model = _chosen(model, same_model)
    if out.exists():
        raise JointIdError(f"{out} exists already: remove it or choose another name")
    if out.suffix.lower() in OTHERS:
        raise JointIdError(f"{out}: a simulation is written as .csv, or else as a bag directory: give such a name")
    if joint == "":
        raise JointIdError("--joint is empty: give a name, or leave it out")
    if joint is not None and out.suffix.lower() == ".csv":
        raise JointIdError(f"{out}: a CSV file holds no name of a joint: leave --joint out, or write a bag")
    if seed < 0:
        raise JointIdError(f"--seed {seed}: give a number from 0 on")
    built = ModelOptions(model, **model_options).build()
    truth = built.values(numbers_by_name(set_ or (), "--set"))

    from joint_id_core import formats
    from joint_id_core.simulation.motion import simulate_motion

    with Progress() as progress:
        progress(f"simulating {duration:g} s of {model}")
        recording = simulate_motion(built, duration, rate, truth, noise, seed)
    formats.write(out, replace(recording, joint=joint or "joint"))
    if json:
        print_json({"file": str(out), "model": model, "samples": len(recording), "truth": truth})
        return
    print(f"{out}: {len(recording)} samples of {', '.join(recording.channels)}; the truth:")
    for p in built.parameters:
        print(f"  {p.name:<9}{truth[p.name]:>12.6g} {p.unit:<10}{p.meaning}")


def _chosen(argument: str | None, option: str | None) -> str:
    """Return the model that was given as the argument, or as --model, as other commands take it."""
    if argument is not None and option is not None and argument != option:
        raise JointIdError(f"two models: {argument} and --model {option}: give one")
    model = argument or option
    if not model:
        raise JointIdError(f"which model? joint-id simulate MODEL --out FILE; there are {', '.join(MODELS)}")
    return model
