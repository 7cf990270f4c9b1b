"""Six simulated joints under position control, on a path of their own or on a trajectory."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.emulator.links import RigidLinks
from joint_id_core.emulator.paths import Followed, Multisines
from joint_id_core.emulator.reference import TICK_S, Reference, Six
from joint_id_core.emulator.robots import Joint
from joint_id_core.emulator.separate_joints import SeparateJoints
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.simulation.coupled_joints import CoupledJoints
from joint_id_core.simulation.position_control import PositionController


class Joints(Protocol):
    """Joints that move: positions and velocities at the motor shaft and at the link, SI units, shape (6,)."""

    @property
    def motor_position(self) -> Array: ...
    @property
    def motor_velocity(self) -> Array: ...
    @property
    def link_position(self) -> Array: ...
    @property
    def link_velocity(self) -> Array: ...

    def rest(self) -> None:
        """Stop at the present positions."""

    def advance(self, dt: float, current: Sequence[float]) -> None:
        """Advance by `dt` in s under motor currents in A."""


class Arm:
    """Six joints. Without `links` there is no coupling and no gravity.

    A tick consists of `decide` (the controllers read the joints and set their currents) and `advance`. Between the two
    `joints` are those of this instant, and `current` in A is held until the next tick.

    With links the controllers add the torque that the reference needs without payload, as those of a robot do.

    Raises:
        JointIdError: an amplitude that is not finite; an arm that is too heavy for its drives.
    """

    def __init__(
        self, joints: Sequence[Joint], moving: Collection[int], amplitude: float, links: RigidLinks | None = None
    ) -> None:
        self._links = links
        self._names = [j.name for j in joints]
        self.reference = Reference(Multisines([j.home for j in joints], moving, amplitude, slow=links is not None))
        self.braked = False
        c = PositionController()
        self._control = [PositionController(j.size * c.k_p, j.size * c.k_d, j.size * c.limit) for j in joints]
        values = [j.values for j in joints]
        self._ratio, self._k_t, rotor = (np.array([v[name] for v in values]) for name in ("N", "k_t", "J_m"))
        self._inertia = self._ratio**2 * rotor
        coulomb, viscous = (
            self._ratio**power * np.array([v[m] for v in values]) + np.array([v[q] for v in values])
            for power, m, q in ((1, "tau_fm", "tau_fq"), (2, "c_m", "c_q"))
        )
        self._coulomb, self._viscous = coulomb, viscous
        start = self.reference.q
        self._start = np.array(start)
        self.joints: Joints
        if links is None:
            self._inertia = self._inertia + np.array([v["J_q"] for v in values])
            self.joints = SeparateJoints(values, start)
        else:
            self._require_held(links)
            self.joints = CoupledJoints(values, links, start)
        self.current: Six = [0.0] * len(values)

    @property
    def target_moment(self) -> Array:
        """Torques that the reference needs without friction and payload, at the link in Nm, shape (6,); 0 if braked."""
        if self.braked:
            return np.zeros(len(self._inertia))
        r = self.reference
        moment: Array = self._inertia * r.qdd
        return moment if self._links is None else moment + self._links.needed(r.q, r.qd, r.qdd)

    def carry(self, mass: float) -> None:
        """Let the last link carry a mass in kg in place of what it carried, 0 for nothing.

        Raises:
            JointIdError: there are no links, or the drives cannot hold it; then nothing changes.
        """
        if self._links is None:
            raise JointIdError("the joints of this robot have no links that carry: start it with --urdf")
        before = self._links.carried
        self._links.carry(mass)
        try:
            self._require_held(self._links)
        except JointIdError:
            self._links.carry(before)
            raise

    def follow(self, trajectory: Trajectory, limits: JointLimits) -> float:
        """Come to rest, go to the start of a trajectory slowly, follow it, and stay at its end.

        Args:
            trajectory: of some of the joints or all.
            limits: of all joints; those of torque are the drives' own.

        Returns:
            Time in s from rest to the begin of the trajectory, from where the joints are now.

        Raises:
            JointIdError: a joint that this robot does not have, a limit that the trajectory breaks, a torque that a
                drive does not give; then nothing changes.
        """
        for name in trajectory.names:
            if name not in self._names:
                raise JointIdError(
                    f"the trajectory moves a joint {name!r}, which this robot does not have"
                    f"{close_to(name, self._names)}: it has {', '.join(self._names)}"
                )
        columns = [self._names.index(name) for name in trajectory.names]
        broken = violations(trajectory, limits) or self._too_weak(trajectory, columns)
        if broken:
            raise JointIdError(f"the robot cannot follow the trajectory: {'; '.join(broken)}")
        self.reference.take(lambda q: Followed(trajectory, columns, q))
        return Followed(trajectory, columns, np.array(self.reference.q)).approach_s

    def _too_weak(self, trajectory: Trajectory, columns: list[int]) -> list[str]:
        """Return where a drive does not give the torque of a trajectory, a sentence each."""
        states = [
            np.tile(row, (len(trajectory.time), 1)) for row in (self.reference.q, *np.zeros((2, len(self._names))))
        ]
        for values, own in zip(
            states, (trajectory.position, trajectory.velocity, trajectory.acceleration), strict=True
        ):
            values[:, columns] = own
        q, qd, qdd = states
        needed = self._inertia * qdd + self._coulomb * np.sign(qd) + self._viscous * qd
        if self._links is not None:
            needed = needed + [self._links.needed(*rows) for rows in zip(q, qd, qdd, strict=True)]
        most = np.array([control.limit for control in self._control]) * self._ratio
        sentences = []
        for j, name in enumerate(self._names):
            k = int(np.argmax(np.abs(needed[:, j])))
            if abs(needed[k, j]) > most[j]:
                sentences.append(
                    f"{name} would need {abs(needed[k, j]):.3g} Nm at {trajectory.time[k]:.3f} s, its drive gives at "
                    f"most {most[j]:.3g} Nm"
                )
        return sentences

    def _require_held(self, links: RigidLinks) -> None:
        """Raise JointIdError if the drives cannot hold the links where the motion starts."""
        needed = abs(links.dynamics(self._start, np.zeros(len(self._start)))[1])
        most = np.array([control.limit for control in self._control]) * self._ratio
        k = int(np.argmax(needed / most))
        if needed[k] > most[k]:
            raise JointIdError(
                f"{self._names[k]} would need {needed[k]:.3g} Nm against gravity at the start, its drive gives "
                f"at most {most[k]:.3g} Nm: take a larger --robot, or less mass"
            )

    def brake(self) -> None:
        """Brakes on, motors off: the joints stop at once at their present positions."""
        self.braked = True
        self.joints.rest()
        self.reference.begin_at(self.joints.link_position.tolist())
        self.current = [0.0] * len(self.current)

    def release(self) -> None:
        """Brakes off, motors on: the joints start at their present positions and return to the path."""
        self.braked = False

    def decide(self, link_position: Array, motor_velocity: Array) -> None:
        """Set the currents of this tick by what the sensors show, in rad and rad/s of link and motor.

        A controller that knew the true state would tell of it by its currents: see `ControlledJoint`.
        """
        if self.braked:
            return
        reference = self.reference
        known = np.zeros(len(self._control)) if self._links is None else self.target_moment / self._ratio
        rows = (known, link_position, motor_velocity / self._ratio)
        seen = zip(reference.q, reference.qd, *(row.tolist() for row in rows), strict=True)
        drives = zip(self._control, self._k_t.tolist(), seen, strict=True)
        self.current = [
            control.torque(q_ref, dq_ref, q, dq, ahead) / k_t for control, k_t, (q_ref, dq_ref, ahead, q, dq) in drives
        ]

    def advance(self, go: bool) -> None:
        """Advance by one tick with the present currents; with `go` the reference moves, else it stops.

        Raises:
            JointIdError: the simulation cannot go on.
        """
        if not self.braked:
            self.joints.advance(TICK_S, self.current)
            self.reference.tick(go)
