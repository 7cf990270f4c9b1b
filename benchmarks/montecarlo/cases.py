"""What is simulated and what is fitted: noise as the estimator assumes it, and noise and friction that it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from simulated import MODEL_1, MODEL_2, MODEL_3, SENSORS, ClosedLoop, Torque, VoltageSteps

from joint_id_core.design.plant import controller_of
from joint_id_core.models import Model, build
from joint_id_core.simulation.sensors import Sensors

FACTOR = 3.0  # how far off start values are at most
LOW, HIGH = 0.003, 0.02  # Nm at the motor: noise of the measured torque
WEAK, STRONG = 0.2, 1.0  # Nm at the link of Model 1: noise of the torque, of which an encoder shows little
SLIGHTLY = 0.1  # of the Coulomb level: the Stribeck level that the fitted law leaves out
RIPPLE = 0.005  # Nm at the motor; the Coulomb level is 0.023
ENCODER = 2.0 * math.pi / 2**19  # rad, link encoder of a UR robot; see `sensors.ur_robot_sensors`
MOTOR_ENCODER = 2.0 * math.pi / 2**13  # rad, of the motor: 13 bits, coarser than the noise of the other cases

ALL_2, ALL_3 = MODEL_2.state_names, MODEL_3.state_names
TWO = ("link_position", "motor_velocity")


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Attributes:
        name: what it is.
        model: what is fitted; the truth is its nominal values.
        motion: what moves.
        labels: what is measured beside the inputs.
        sensors: how.
        as_assumed: whether the data are what the estimator assumes, so that its intervals must hold.
    """

    name: str
    model: Model
    motion: ClosedLoop | VoltageSteps
    labels: tuple[str, ...]
    sensors: Sensors = SENSORS
    as_assumed: bool = True


def _without(labels: tuple[str, ...], name: str) -> tuple[str, ...]:
    return tuple(label for label in labels if label != name)


def _loop(noise: float, labels: tuple[str, ...]) -> Case:
    what = "all four states" if labels == ALL_2 else "link position, motor velocity"
    return Case(f"Model 2, {what}, {noise:g} Nm", MODEL_2, ClosedLoop(torque=Torque(white=noise)), labels)


def _rigid(noise: float) -> Case:
    """With an encoder alone, whose noise hides that of the torque: its level is hardly known."""
    motion = ClosedLoop(torque=Torque(white=noise), plant=MODEL_1, controller=controller_of(MODEL_1, MODEL_1.values()))
    return Case(f"Model 1, link position, {noise:g} Nm", MODEL_1, motion, ("link_position",))


def _stribeck() -> ClosedLoop:
    plant = build("harmonic_drive", friction="stribeck")
    nominal = plant.values()
    levels = {f"dtau_s{side}": SLIGHTLY * nominal[f"tau_f{side}"] for side in ("m", "q")}
    return ClosedLoop(torque=Torque(white=LOW), plant=plant, values=levels)


def _rounded() -> Sensors:
    """Positions rounded by their encoders and otherwise exact: a harsher test than rounding below noise."""
    noise = {name: std for name, std in SENSORS.noise.items() if not name.endswith("position")}
    return Sensors(noise=noise, quantum={"link_position": ENCODER, "motor_position": MOTOR_ENCODER})


_LOW = _loop(LOW, ALL_2)
CASES = (
    _LOW,
    _loop(HIGH, ALL_2),
    _loop(LOW, TWO),
    _loop(HIGH, TWO),
    _rigid(WEAK),
    _rigid(STRONG),
    Case("Model 3, all five states", MODEL_3, VoltageSteps(), ALL_3),
    Case("Model 3, without the current", MODEL_3, VoltageSteps(), _without(ALL_3, "current")),
    Case("Model 3, without the link velocity", MODEL_3, VoltageSteps(), _without(ALL_3, "link_velocity")),
    replace(_LOW, name="encoders that round", sensors=_rounded(), as_assumed=False),
    replace(
        _LOW, name=f"coloured torque, {LOW:g} Nm", motion=ClosedLoop(torque=Torque(LOW, coloured=LOW)), as_assumed=False
    ),
    replace(
        _LOW, name=f"coloured torque, {HIGH:g} Nm", motion=ClosedLoop(torque=Torque(LOW, coloured=HIGH)),
        as_assumed=False,
    ),
    replace(
        _LOW, name=f"torque ripple of {RIPPLE:g} Nm", motion=ClosedLoop(torque=Torque(LOW, ripple=RIPPLE)),
        as_assumed=False,
    ),
    replace(
        _LOW, name=f"noise of the torque sensor, {LOW:g} Nm", motion=ClosedLoop(),
        sensors=Sensors(noise={**SENSORS.noise, "torque": LOW}), as_assumed=False,
    ),
    replace(_LOW, name=f"Stribeck friction, {SLIGHTLY:.0%}", motion=_stribeck(), as_assumed=False),
)  # fmt: skip
