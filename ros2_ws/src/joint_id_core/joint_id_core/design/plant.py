"""The joint that a planned motion moves: what is simulated for a model, its controller and its sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from joint_id_core.cell.kernel import Kernel, compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive, Model, MotorSide
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.simulation.position_control import PositionController
from joint_id_core.simulation.sensors import UR_CHANNELS, Sensors, ur_robot_sensors

SETTLE_S = 0.5  # the controller holds a loaded joint this long before the motion, so that it carries its load
LOADS = ("a_g", "b_g", "tau_0")  # parameters that load a joint at rest
# Estimators smooth the step of Coulomb friction; a joint sticks. The difference biases estimates where a joint often
# reverses, so it belongs to what a motion will tell. With a fortieth of the smoothing velocities biases are those of
# exact stick and slip, within some percent. With a tenth some are off by half, but motions are ranked four times as
# fast.
SHARPER, SHARP = 40.0, 10.0
NEAR = 6.0  # smoothing velocities from standstill within which friction is stiff
STEP_S = 1e-3  # integrator step away from standstill
STABLE = 2.2  # |lambda h| of the fastest mode at standstill; Runge-Kutta 4 is stable up to 2.78
MOST = 500  # integrator steps of a sample


def plant_of(model: Model) -> Model:
    """Return the model that is simulated for a joint: one that a position controller can move.

    For `motor_side`, which takes the motion of the link as measured, this is the flexible joint with the same motor.

    Raises:
        JointIdError: the drive is a voltage, or the model has no link position.
    """
    if model.drive == "voltage":
        raise JointIdError(
            f"model {model.name} is driven by a voltage, which no robot takes: a motion can be designed for "
            "harmonic_drive, motor_side and rigid_joint; steps of voltage come from `joint-id simulate`"
        )
    if isinstance(model, MotorSide):
        return HarmonicDrive(model.actuation, model.friction, True, model.kinematic_error, offsets=True)
    if model.torque_drive is None or "link_position" not in model.state_names:
        raise JointIdError(
            f"model {model.name}: a motion is designed for models with a torque or current as an input and the link's "
            "position as a state (harmonic_drive, rigid_joint), and for motor_side"
        )
    return model


def sensors_of(model: Model, values: Mapping[str, float]) -> Sensors:
    """Return the sensors of a UR robot for a joint. A torque that is given at the link is as noisy as the motor's."""
    N = model.gear_ratio(values)
    known = ur_robot_sensors(N)
    torque = known.noise["torque"] * GEAR_RATIO / N
    return Sensors({**known.noise, "torque": torque}, known.quantum)


def controller_of(plant: Model, values: Mapping[str, float]) -> PositionController:
    """Return the controller of a joint: the default one, scaled to the joint's inertia and gear ratio."""

    def inertia(of: Mapping[str, float], N: float) -> float:
        return of.get("J_q", 0.0) + of.get("J", 0.0) + N**2 * of.get("J_m", 0.0)

    default, N = PositionController(), plant.gear_ratio(values)
    usual = inertia({p.name: p.nominal for p in HarmonicDrive().parameters}, GEAR_RATIO)
    scale = GEAR_RATIO / N * (inertia(values, N) / usual or 1.0)
    return PositionController(default.k_p * scale, default.k_d * scale, math.inf)


@dataclass(frozen=True)
class Moved:
    """A joint that has followed a reference.

    Attributes:
        recording: the exact values of states and drive.
        torque: the largest torque of the drive, at the link, in Nm.
    """

    recording: Recording
    torque: float


@dataclass(frozen=True)
class Plant:
    """A joint under position control, simulated with the compiled cell.

    Attributes:
        model: what moves, see `plant_of`.
        controller: its controller.
    """

    model: Model
    controller: PositionController

    @cached_property
    def _kernel(self) -> Kernel:
        return compile_model(self.model)

    def follow(
        self, values: Mapping[str, float], position: Array, velocity: Array, period: float, sharper: float = SHARPER
    ) -> Moved:
        """Let a joint with these parameters follow positions (T,) in rad and velocities (T,) in rad/s of its link.

        Its friction is so many times `sharper` than that of a fit.

        Raises:
            JointIdError: the simulation does not stay finite.
        """
        model, names = self.model, self.model.state_names
        before = round(SETTLE_S / period) if any(values.get(name, 0.0) != 0.0 for name in LOADS) else 0
        q, dq = np.concatenate([np.full(before, position[0]), position]), np.pad(velocity, (before, 0))
        N, k_t = model.gear_ratio(values), model.torque_constant(values)
        side = "motor_velocity" if "motor_velocity" in names else "link_velocity"
        x0 = np.zeros(len(names))
        x0[names.index("link_position")] = q[0]
        if "motor_position" in names:
            x0[names.index("motor_position")] = N * q[0]
        drive = model.input_names.index(model.torque_drive or "")
        u, X = np.zeros((len(q), len(model.inputs))), np.empty((len(q), len(names)))
        p = np.array([values[name] for name in model.parameter_names])
        slow = np.zeros(len(names))
        for state, smoothing in model.smoothing.items():
            k = model.parameter_names.index(smoothing)
            p[k] /= sharper
            slow[names.index(state)] = NEAR * p[k]
        few, c = math.ceil(period / STEP_S - 1e-9), self.controller
        gains = np.array([c.k_p, c.k_d, c.limit, k_t, 1.0 / N if side == "motor_velocity" else 1.0])
        self._kernel.control.follow(
            x0, np.arange(len(q)) * period, np.ascontiguousarray(q), np.ascontiguousarray(dq), gains,
            np.array([drive, names.index("link_position"), names.index(side)]), slow, p,
            few, min(MOST, max(few, math.ceil(self._standing_mode(x0, p) * period / STABLE))), u, X,
        )  # fmt: skip
        u, X = u[before:], X[before:]
        if not (np.isfinite(X).all() and np.isfinite(u).all()):
            raise JointIdError(
                f"{model.name}: the simulated joint does not follow the motion with these parameters: give values near "
                "those of the joint (--set)"
            )
        channels = {model.torque_drive or "": u[:, drive].copy()}
        channels |= {name: X[:, k].copy() for k, name in enumerate(names)}
        recording = Recording(np.asarray(np.arange(len(X)) * period, dtype=float), channels, source="planned motion")
        return Moved(recording, float(N * k_t * np.abs(u[:, drive]).max()))

    def _standing_mode(self, x: Array, p: Array) -> float:
        """Return the largest |lambda| in 1/s of the joint at standstill: that of the steep slope of its friction."""
        A = np.empty((1, len(x), len(x)))
        self._kernel.module.jacobians(x[None].copy(), np.zeros((1, len(self.model.inputs))), p, A)
        return float(self._kernel.module.spectral_radius(A))


def as_recorded(recording: Recording, sensors: Sensors, seed: int = 0) -> Recording:
    """Return what a UR robot would record of a motion."""
    return sensors.measure(recording, seed, [name for name in UR_CHANNELS if name in recording])
