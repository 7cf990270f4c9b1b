"""A planned motion: evenly spaced samples of position, velocity and acceleration, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

AT_REST = 1e-6  # rad/s and rad/s^2, below which a joint stands at the start and end
# Shares of the largest velocity and acceleration by which the columns may contradict each other between two samples.
# A motion of 3 Hz at 10 samples a second, which is coarse, misses by 0.02 and 0.3.
VELOCITY_SLACK, ACCELERATION_SLACK = 0.05, 0.35


class State(NamedTuple):
    """Position and its first three derivatives of all joints, each of shape (n, joints), rad (or m) and s."""

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion that starts and ends at rest.

    Attributes:
        names: of the joints.
        time: instants in s, shape (n,), from 0 on, evenly spaced.
        position, velocity, acceleration: rad, rad/s, rad/s^2 (m for a joint that slides), shape (n, joints).

    Raises:
        JointIdError: no joint, a name twice, wrong shapes, values that are not finite, time that does not begin at 0 or
            is not even, velocities or accelerations that are not those of the positions, no rest at the start or end.
    """

    names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        names = tuple(self.names)
        arrays = {
            name: np.asarray(getattr(self, name), dtype=float)
            for name in ("time", "position", "velocity", "acceleration")
        }
        object.__setattr__(self, "names", names)
        for name, values in arrays.items():
            object.__setattr__(self, name, values)
        self._check_form()
        self._check_time()
        self._check_motion()

    @property
    def period(self) -> float:
        """Time between samples in s."""
        return self.duration / (len(self.time) - 1)

    @property
    def duration(self) -> float:
        """Length of the motion in s."""
        return float(self.time[-1])

    @property
    def rate(self) -> float:
        """Samples in a second."""
        return 1.0 / self.period

    def at(self, time: ArrayLike) -> State:
        """Return the motion at instants in s, shape (n,): the quintic polynomial that joins two samples.

        Controllers do the same (joint_trajectory_controller, with velocities and accelerations given). Before the
        start and after the end the joints stand.
        """
        instants = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        period = self.period
        k = np.minimum((instants / period).astype(int), len(self.time) - 2)
        x = (instants / period - k)[:, None]
        q, v, a = self.position, self.velocity * period, self.acceleration * period**2
        # with e, f, g: what constant acceleration from the first sample leaves to the second one
        e = q[k + 1] - q[k] - v[k] - a[k] / 2.0
        f = v[k + 1] - v[k] - a[k]
        g = a[k + 1] - a[k]
        c3, c4, c5 = 10.0 * e - 4.0 * f + g / 2.0, -15.0 * e + 7.0 * f - g, 6.0 * e - 3.0 * f + g / 2.0
        return State(
            q[k] + x * (v[k] + x * (a[k] / 2.0 + x * (c3 + x * (c4 + x * c5)))),
            (v[k] + x * (a[k] + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / period,
            (a[k] + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / period**2,
            (6.0 * c3 + x * (24.0 * c4 + x * 60.0 * c5)) / period**3,
        )

    def between(self, parts: int) -> State:
        """Return the motion at `parts` instants for each sample, the samples among them."""
        return self.at(np.linspace(0.0, self.duration, (len(self.time) - 1) * parts + 1))

    def of(self, joint: str) -> Trajectory:
        """Return the motion of one joint.

        Raises:
            JointIdError: it does not move that joint.
        """
        if joint not in self.names:
            raise JointIdError(f"the trajectory has no joint {joint!r}: it moves {', '.join(self.names)}")
        k = self.names.index(joint)
        one = np.s_[:, k : k + 1]
        return Trajectory((joint,), self.time, self.position[one], self.velocity[one], self.acceleration[one])

    def moves(self, joint: str) -> tuple[float, float]:
        """Return the first and the last instant in s of the motion of one joint; the whole motion if it stands.

        Raises:
            JointIdError: it does not move that joint.
        """
        rows = np.flatnonzero(np.abs(self.of(joint).velocity[:, 0]) > AT_REST)
        if not len(rows):
            return 0.0, self.duration
        return float(self.time[rows[0] - 1]), float(self.time[rows[-1] + 1])

    def _check_form(self) -> None:
        names, time = self.names, self.time
        if not names or len(set(names)) < len(names):
            raise JointIdError(f"trajectory of the joints {', '.join(names) or '(none)'}: name each joint once")
        if time.ndim != 1 or len(time) < 2:
            raise JointIdError(f"trajectory: time has shape {time.shape}: two samples or more are needed, in one row")
        for name in ("position", "velocity", "acceleration"):
            values: Array = getattr(self, name)
            if values.shape != (len(time), len(names)):
                raise JointIdError(
                    f"trajectory: {name} has shape {values.shape}: {len(time)} samples of {len(names)} joints are "
                    "needed"
                )
            if not (finite := np.isfinite(values)).all():
                k, joint = np.argwhere(~finite)[0]
                raise JointIdError(f"trajectory: {name} of {names[joint]} at sample {k} is {values[k, joint]}")

    def _check_time(self) -> None:
        time = self.time
        if not np.isfinite(time).all() or time[0] != 0.0 or time[-1] <= 0.0:
            raise JointIdError(f"trajectory: time goes from {time[0]:g} to {time[-1]:g} s: it must begin at 0 and rise")
        uneven = np.abs(time - np.linspace(0.0, time[-1], len(time)))
        if uneven.max() > 1e-3 * self.period:
            k = int(np.argmax(uneven))
            raise JointIdError(f"trajectory: the samples are not evenly spaced (sample {k} at {time[k]:.9g} s)")

    def _check_motion(self) -> None:
        period = self.period
        q, v, a = self.position, self.velocity, self.acceleration
        for name, values in (("velocity", v), ("acceleration", a)):
            for when, k in (("start", 0), ("end", -1)):
                if (moving := np.abs(values[k]) > AT_REST).any():
                    j = int(np.argmax(moving))
                    raise JointIdError(
                        f"trajectory: {self.names[j]} has {name} {values[k, j]:.3g} at the {when}: a motion starts and "
                        "ends at rest"
                    )
        moved = np.diff(q, axis=0) - period / 2.0 * (v[1:] + v[:-1]) + period**2 / 12.0 * np.diff(a, axis=0)
        gained = np.diff(v, axis=0) - period / 2.0 * (a[1:] + a[:-1])
        for name, missed, values, slack in (
            ("velocity", moved / period, v, VELOCITY_SLACK),
            ("acceleration", gained / period, a, ACCELERATION_SLACK),
        ):
            wrong: NDArray[np.bool_] = np.abs(missed) > slack * np.abs(values).max(axis=0) + AT_REST
            if wrong.any():
                k, j = np.argwhere(wrong)[0]
                what = "position" if name == "velocity" else "velocity"
                raise JointIdError(
                    f"trajectory: {name} of {self.names[j]} is not the derivative of its {what} "
                    f"({self.time[k]:.6g} to {self.time[k + 1]:.6g} s): check units and columns, or sample it faster"
                )
