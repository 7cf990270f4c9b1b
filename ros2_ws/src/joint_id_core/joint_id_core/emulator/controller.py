"""The controller of the emulated robot: clock, modes, sensors and registers."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.emulator.arm import Arm
from joint_id_core.emulator.links import RigidLinks
from joint_id_core.emulator.reference import TICK_S
from joint_id_core.emulator.robots import Joint
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import FIELDS, JOINTS, TYPES, register_type
from joint_id_core.rtde.modes import JointMode, RobotMode, SafetyMode
from joint_id_core.rtde.packets import Value
from joint_id_core.simulation.sensors import ur_robot_sensors

REGISTERS = 48
MOTOR_POSITION_REGISTER, MOTOR_VELOCITY_REGISTER = 24, 30  # number of the first of six output_double_register_..

# Bits of the status fields. Source: Universal Robots, RTDE guide.
POWER_ON, PROGRAM_RUNNING = 1 << 0, 1 << 1
NORMAL_MODE, PROTECTIVE_STOPPED, STOPPED_DUE_TO_SAFETY = 1 << 0, 1 << 2, 1 << 10

# Fictitious values of a joint of the size of Table V; heat capacity and cooling of others are proportional to the size.
_AMBIENT, _WARMEST_START = 25.0, 30.0  # deg C
_HEAT_CAPACITY, _COOLING = 800.0, 0.4  # J/K, W/K: time constant 33 minutes
_RESISTANCE = 0.5  # ohm
_RAIL, _RAIL_DROP, _RAIL_NOISE = 48.0, 0.05, 0.05  # V, ohm, V

_NOISE_BLOCK = 512  # number of ticks for which noise is generated at once


class Controller:
    """A controller from power-up on. `values` holds every field and register as reported at this tick.

    Args:
        joints: joints of the robot.
        moving: indices of the joints that move.
        amplitude: peak of their motion in rad.
        version: version of the controller, (major, minor, ...).
        without: fields that it does not have although its version has them.
        seed: seed of the noise.
        description: of the links; without, joints have no gravity and do not act on each other.
        limits: of the joints, for trajectories; without, their drives alone limit these.

    Raises:
        JointIdError: links that the robot cannot have or hold.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        moving: Collection[int],
        amplitude: float,
        version: tuple[int, ...],
        without: Collection[str] = (),
        seed: int = 0,
        description: Description | None = None,
        limits: JointLimits | None = None,
    ) -> None:
        self._limits = limits or JointLimits.none([j.name for j in joints])
        links = None if description is None else RigidLinks(description)
        self.arm = Arm(joints, moving, amplitude, links)
        self.version = version
        self.stopped = False
        self.clock_offset = 0.0
        self.ticks = 0
        self._without = frozenset(without)
        self._rng = np.random.default_rng(seed)
        values = {name: np.array([j.values[name] for j in joints]) for name in joints[0].values}
        self._ratio, self._k_t = values["N"], values["k_t"]
        self._c_m, self._c_q = values["c_m"], values["c_q"]
        self._tau_fm, self._tau_fq = values["tau_fm"], values["tau_fq"]
        self._size = np.array([j.size for j in joints])
        self._temperature = np.linspace(_AMBIENT, _WARMEST_START, len(joints))
        sensors = [ur_robot_sensors(n) for n in self._ratio.tolist()]
        rows = ("link_position", "motor_position", "motor_velocity", "current")
        self._std = np.array([[s.noise[row] for s in sensors] for row in rows])
        self._step = np.array([[s.quantum[row] for s in sensors] for row in rows[:2]])
        self._noise = np.empty((0, len(rows) + 1, JOINTS))
        self._errors, self._shown = np.zeros((len(rows) + 1, JOINTS)), np.zeros((3, JOINTS))
        self.values: dict[str, Value | Sequence[float]] = {}
        for f in FIELDS.values():
            count = TYPES[f.type][1]
            self.values[f.name] = 0.0 if count == 1 else [0.0] * count
        for direction in ("input", "output"):
            for kind in ("int", "double"):
                self.values.update({f"{direction}_{kind}_register_{k}": 0 for k in range(REGISTERS)})

    def type_of(self, name: str) -> str | None:
        """Return the type of an output field; None if this controller does not have it."""
        if name in self._without:
            return None
        if name in FIELDS:
            return FIELDS[name].type if FIELDS[name].sent_by(self.version) else None
        return register_type(name)

    @staticmethod
    def input_type_of(name: str) -> str | None:
        """Return the type of an input field; None if there is no such field."""
        return register_type(name) if name.startswith("input_") else None

    def power(self, on: bool) -> bool:
        """Switch the arm on or off; return False if it was in this state before."""
        if on is not self.arm.braked:
            return False
        if on:
            self.arm.release()
        else:
            self.arm.brake()
        return True

    def protective_stop(self, stop: bool) -> bool:
        """Stop the joints, or let them continue; return False if they were in this state before."""
        changed, self.stopped = self.stopped is not stop, stop
        return changed

    def follow(self, trajectory: Trajectory) -> float:
        """Let the joints follow a trajectory, from where they are: see `Arm.follow`.

        Raises:
            JointIdError: they cannot, or the robot is off or stopped; then nothing changes.
        """
        if self.arm.braked or self.stopped:
            way = "power-on" if self.arm.braked else "unlock"
            raise JointIdError(f"the robot is {'off' if self.arm.braked else 'stopped'}: give {way} first")
        return self.arm.follow(trajectory, self._limits)

    def tick(self) -> None:
        """Read the sensors and set the currents of this tick; `values` is updated only by `report`."""
        if not len(self._noise):
            self._noise = self._rng.standard_normal((_NOISE_BLOCK, *self._noise.shape[1:]))
        self._errors, self._noise = self._noise[0], self._noise[1:]
        if self.arm.braked:  # the electronics of the joints are off: the last positions remain
            self._errors = np.zeros_like(self._errors)
        joints = self.arm.joints
        self._shown = np.array((joints.link_position, joints.motor_position, joints.motor_velocity))
        self._shown += self._errors[:3] * self._std[:3]
        self._shown[:2] = np.round(self._shown[:2] / self._step) * self._step
        self.arm.decide(self._shown[0], self._shown[2])

    def advance(self) -> None:
        """Advance to the next tick.

        Raises:
            JointIdError: the simulation cannot go on.
        """
        self._warm_up()
        self.arm.advance(go=not self.stopped)
        self.ticks += 1

    def _warm_up(self) -> None:
        """Update the temperatures: copper loss and friction heat a joint, the air cools it."""
        arm = self.arm
        heat = 0.0
        if not arm.braked:
            current, w_m, w_q = np.array((arm.current, arm.joints.motor_velocity, arm.joints.link_velocity))
            w_m, w_q = abs(w_m), abs(w_q)
            friction = w_m * (self._tau_fm + self._c_m * w_m) + w_q * (self._tau_fq + self._c_q * w_q)
            heat = _RESISTANCE * current * current + friction
        cooling = _COOLING * self._size * (self._temperature - _AMBIENT)
        self._temperature += (heat - cooling) * (TICK_S / _HEAT_CAPACITY) / self._size

    def report(self) -> None:
        """Update `values`; call it between `tick` and `advance`."""
        arm, values = self.arm, self.values
        values["timestamp"] = self.ticks * TICK_S + self.clock_offset
        values["target_q"], values["target_qd"], values["target_qdd"] = (
            arm.reference.q, arm.reference.qd, arm.reference.qdd,
        )  # fmt: skip
        moment = arm.target_moment
        values["target_moment"] = moment.tolist()
        values["target_current"] = (moment / (self._ratio * self._k_t)).tolist()
        values["joint_control_output"] = arm.current
        values["joint_temperatures"] = self._temperature.tolist()
        values["speed_scaling"] = arm.reference.pace
        self._report_modes()
        current = np.array(arm.current)
        rail = _RAIL - _RAIL_DROP * abs(current) + _RAIL_NOISE * self._errors[4]
        if arm.braked:
            rail = np.zeros(JOINTS)
        shown = np.vstack((self._shown, current + self._errors[3] * self._std[3]))
        values["actual_qd"] = (shown[2] / self._ratio).tolist()
        values["actual_current_as_torque"] = (shown[3] * self._k_t * self._ratio).tolist()
        values["actual_joint_voltage"] = rail.tolist()
        rows = shown.tolist()
        values["actual_q"], values["actual_current"] = rows[0], rows[3]
        self._fill_registers(MOTOR_POSITION_REGISTER, rows[1])
        self._fill_registers(MOTOR_VELOCITY_REGISTER, rows[2])

    def _fill_registers(self, first: int, six: Sequence[float]) -> None:
        for i, value in enumerate(six, first):
            self.values[f"output_double_register_{i}"] = value

    def _report_modes(self) -> None:
        values, on = self.values, not self.arm.braked
        values["robot_mode"] = RobotMode.RUNNING if on else RobotMode.POWER_OFF
        values["joint_mode"] = [JointMode.RUNNING if on else JointMode.POWER_OFF] * JOINTS
        values["safety_mode"] = SafetyMode.PROTECTIVE_STOP if self.stopped else SafetyMode.NORMAL
        values["robot_status_bits"] = (POWER_ON if on else 0) | (PROGRAM_RUNNING if on and not self.stopped else 0)
        values["safety_status_bits"] = PROTECTIVE_STOPPED | STOPPED_DUE_TO_SAFETY if self.stopped else NORMAL_MODE
