"""`joint-id simulate`: make a recording of a model with known parameters."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from joint_id_core.cli.arguments import Progress, numbers, print_json
from joint_id_core.cli.model_options import (
    MODEL_HELP,
    ActuationOption,
    FrictionOption,
    GravityOption,
    KinematicErrorOption,
    SetOption,
    build_model,
)
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.data.recording import Array, Recording
    from joint_id_core.models import Model


def simulate(
    model: Annotated[str, typer.Argument(help=MODEL_HELP)],
    out: Annotated[Path, typer.Option(help="what to write: a .csv file, or else a bag directory")],
    duration: Annotated[float, typer.Option(help="length in s")] = 6.0,
    rate: Annotated[float, typer.Option(help="samples a second")] = 500.0,
    seed: Annotated[int, typer.Option(help="of the noise")] = 0,
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="sensors of a UR robot, or exact values")] = True,
    set_: SetOption = None,
    joint: Annotated[str, typer.Option(help="name of the joint in the bag")] = "joint",
    actuation: ActuationOption = None,
    friction: FrictionOption = None,
    gravity: GravityOption = False,
    kinematic_error: KinematicErrorOption = False,
    json: Annotated[bool, typer.Option("--json", help="machine-readable result")] = False,
) -> None:
    """Simulate a joint with known parameters and write what its sensors show.

    Models with a voltage get steps of it; the others follow a multisine of the link position.
    """
    if out.exists():
        raise JointIdError(f"{out} exists already: remove it or choose another name")
    for name, value in (("--duration", duration), ("--rate", rate)):
        if not (math.isfinite(value) and value > 0.0):
            raise JointIdError(f"{name} {value:g}: give a number above 0")
    built = build_model(model, actuation, friction, gravity=gravity, kinematic_error=kinematic_error)
    truth = built.values(numbers(set_ or (), "--set"))

    import numpy as np

    from joint_id_core import formats
    from joint_id_core.simulation.sensors import ur_robot_sensors

    time = np.arange(round(duration * rate) + 1) / rate
    with Progress() as progress:
        progress(f"simulating {duration:g} s of {model}")
        recording = _motion(built, time, truth)
    if noise:
        sensors = ur_robot_sensors(truth.get("N", 1.0))
        known = set(sensors.noise) | {"voltage"}  # the commanded voltage is exact; there is no link velocity sensor
        recording = sensors.measure(recording, seed, known & set(recording.channels))
    if out.suffix.lower() == ".csv":
        formats.write_csv(out, recording)
    else:
        formats.write_bag(out, {joint: recording})
    if json:
        print_json({"file": str(out), "model": model, "samples": len(recording), "truth": truth})
        return
    print(f"{out}: {len(recording)} samples of {', '.join(recording.channels)}; the truth:")
    for p in built.parameters:
        print(f"  {p.name:<9}{truth[p.name]:>12.6g} {p.unit:<10}{p.meaning}")


def _motion(model: Model, time: Array, truth: dict[str, float]) -> Recording:
    """Move the joint in a way that shows its parameters; no external torque."""
    import numpy as np

    from joint_id_core.data.recording import Recording
    from joint_id_core.models.transmission import GEAR_RATIO
    from joint_id_core.simulation.excitation import STEP_S, STEPS_V, multisine, position_reference
    from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
    from joint_id_core.simulation.simulator import simulate as open_loop

    reference = position_reference()
    if "voltage" in model.input_names:
        level = np.floor(time / STEP_S + 1e-9).astype(int) % len(STEPS_V)
        recording = open_loop(model, time, {"voltage": np.array(STEPS_V)[level]}, truth)
    elif "link_position" in model.state_names:
        default = PositionController()  # made for a gear of GEAR_RATIO; the same torque at the link for any other
        scale = GEAR_RATIO / truth["N"]
        controller = PositionController(default.k_p * scale, default.k_d * scale, default.limit * scale)
        recording = simulate_closed_loop(model, controller, reference, time, truth)
    else:
        q, dq = reference.value(time), reference.rate(time)
        drive = next(n for n in model.input_names if n in ("torque", "current"))
        torque = multisine(time, 0.3, reference.frequencies, seed=2)
        inputs = {drive: torque / truth.get("k_t", 1.0), "link_position": q, "link_velocity": dq}
        x0 = {"motor_position": truth["N"] * q[0], "motor_velocity": truth["N"] * dq[0]}
        recording = open_loop(model, time, inputs, truth, x0)
    channels = {name: values for name, values in recording.channels.items() if name != "external_torque"}
    return Recording(recording.time, channels, source=recording.source)
