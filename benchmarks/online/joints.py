"""The simulated joint behind each model: what moves, what its sensors show, and what the model should find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.filtering.offline import complete
from joint_id_core.models import Model, build
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.simulation.position_control import ControlledJoint, PositionController
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import JointSimulator
from online.motions import PointToPoint, Voltage, reference

K_T = 0.1  # Nm/A, that of a UR joint; the drivers of the robot believe in it
TORQUE_NOISE = 0.003  # Nm at the motor shaft, that the recorded current does not show
VOLTAGE_NOISE = 0.03  # V, which drives as much current as the torque noise
SPREAD = 0.15  # how far a joint is at most from the nominal one, from which the search begins
SENSORS = Sensors(noise={"link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3, "current": 0.05})
FRICTION = ("c_m", "tau_fm", "c_q", "tau_fq")
STIFFNESS = ("k_1", "k_2")


@dataclass(frozen=True)
class Joint:
    """One model and the joint that it watches.

    Attributes:
        model: that is identified.
        plant: that moves.
        nominal: values of the plant that replace those of its table.
        shown: channels that the identifier gets.
        encoder: channel of the sensor that fails.
        parts: parameters of the plant by part.
        lacks: cases that make no sense, by part or fault, with the reason.
        freed: parameters that the identifier estimates beside those of its table.
        rate: of the samples in Hz; electrical time constants need a higher one.
    """

    model: Model
    plant: Model
    nominal: Mapping[str, float]
    shown: tuple[str, ...]
    encoder: str
    parts: Mapping[str, tuple[str, ...]]
    lacks: Mapping[str, str] = field(default_factory=dict)
    freed: tuple[str, ...] = ()
    rate: int = 500

    @property
    def settings(self) -> ParameterSettings:
        """What the identifier is told."""
        known = {n: v for n, v in self.nominal.items() if n in self.model.parameter_names}
        return ParameterSettings(known, freed=self.freed)

    def values(self, seed: int) -> dict[str, float]:
        """Parameters of the plant: those that are estimated are up to `SPREAD` off the nominal ones."""
        values = self.plant.values(self.nominal)
        free = [p.name for p in self.plant.parameters if not p.fixed or p.name in self.freed]
        off = np.random.default_rng([seed, 11]).uniform(1.0 - SPREAD, 1.0 + SPREAD, len(free))
        return {**values, **{n: values[n] * by for n, by in zip(free, off.tolist(), strict=True)}}

    def truth(self, values: Mapping[str, float], offset: float = 0.0) -> dict[str, float]:
        """What the model should find when the plant has these values and the current in A is off by `offset`."""
        if self.plant.drive == "voltage":
            return dict(values)
        # The model believes in K_T: it sees all torques and inertias in that unit.
        scaled = {n: v * K_T / values["k_t"] for n, v in values.items() if n in self.model.parameter_names}
        if self.model.has_torque_offset:
            at_link = values["N"] if self.model.name == "rigid_joint" else 1.0
            scaled["tau_0"] = offset * K_T * at_link
        return scaled

    def moving(self, motion: str, values: Mapping[str, float], seed: int) -> ControlledJoint | VoltageJoint:
        """A joint that starts to move."""
        if self.plant.drive == "voltage":
            return VoltageJoint(self.plant, Voltage(motion, PointToPoint(seed)), values, seed)
        return ControlledJoint(
            self.plant, PositionController(), reference(motion, seed), values, torque_noise=TORQUE_NOISE, seed=seed,
            sensors=SENSORS,
        )  # fmt: skip

    def recording(self, time: Array, channels: Mapping[str, Array]) -> Recording:
        """What the identifier gets: measured channels, and derivatives that the model needs as inputs."""
        measured = Recording(time, {n: channels[n] for n in self.shown}, source=self.model.name)
        missing = set(self.model.input_names) - self.model.optional_inputs - set(self.shown)
        if not missing:
            return measured
        derived = complete(measured)
        return measured.with_channels({n: derived[n] for n in missing}, derived=True)


class VoltageJoint:
    """A motor under a voltage, with sensors; see `ControlledJoint` for attributes and methods.

    The voltage plus white noise acts on the motor, constant over a period.
    """

    def __init__(self, model: Model, voltage: Voltage, values: Mapping[str, float], seed: int) -> None:
        self.joint = JointSimulator(model, values)
        self._voltage, self._rng = voltage, np.random.default_rng([seed, 1])
        self.shown = self._look()

    def _look(self) -> dict[str, float]:
        return {n: float(SENSORS.reading(n, x, self._rng)) for n, x in self.joint.state.items()}

    def change(self, values: Mapping[str, float]) -> None:
        """Go on with other parameters."""
        self.joint.change(values)

    def tick(self, dt: float) -> dict[str, float]:
        """Hold the present voltage for `dt` in s; return it."""
        voltage = self._voltage(self.joint.time)
        self.joint.advance(dt, {"voltage": voltage + VOLTAGE_NOISE * self._rng.standard_normal()})
        self.shown = self._look()
        return {"voltage": voltage}


_M2 = build("harmonic_drive", actuation="current")
_GEAR = {"k_t": K_T, "N": GEAR_RATIO}
_DRIVE = {"drive": ("k_t",)}
# The whole of Model 2 with a stiff gear, seen at the link.
_RIGID = {**_GEAR, "J": 1.39, "c": 2.84, "tau_f": 4.61}
_RIGID_GEAR = {"stiffness": "no flexible gear"}

JOINTS = {
    "harmonic_drive": Joint(
        _M2, _M2, _GEAR, ("link_position", "motor_velocity", "current"), "link_position",
        {"load": ("J_q",), "friction": FRICTION, "stiffness": STIFFNESS, **_DRIVE},
    ),
    "motor_side": Joint(
        build("motor_side", actuation="current"), _M2, _GEAR, ("link_position", "motor_velocity", "current"),
        "link_position", {"load": ("J_q",), "friction": FRICTION, "stiffness": STIFFNESS, **_DRIVE},
    ),
    "rigid_joint": Joint(
        build("rigid_joint", actuation="current"), build("rigid_joint", actuation="current"), _RIGID,
        ("link_position", "current"), "link_position", {"load": ("J",), "friction": ("c", "tau_f"), **_DRIVE},
        _RIGID_GEAR,
    ),
    "electromechanical": Joint(
        build("electromechanical"), build("electromechanical"), {},
        ("current", "link_position", "motor_velocity", "voltage"), "link_position",
        {"load": ("J_q",), "friction": ("c_m", "tau_fm", "c_q"), "stiffness": STIFFNESS, "drive": ("k_t", "k_b")},
        freed=("J_q",), rate=1000,
    ),
    "dc_motor": Joint(
        build("dc_motor"), build("dc_motor"), {}, ("current", "motor_velocity", "voltage"), "motor_velocity",
        {"friction": ("c_b", "tau_fc"), "drive": ("k_t", "k_b")}, {**_RIGID_GEAR, "load": "no load"}, rate=1000,
    ),
}  # fmt: skip


def joint(name: str) -> Joint:
    """The joint of a model.

    Raises:
        JointIdError: no such model.
    """
    if name not in JOINTS:
        raise JointIdError(f"no joint is simulated for model {name!r}: known are {', '.join(JOINTS)}")
    return JOINTS[name]
