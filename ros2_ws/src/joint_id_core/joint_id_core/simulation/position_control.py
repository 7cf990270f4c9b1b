"""A sampled position controller, and a simulated joint under its control."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import JointSimulator


class Reference(Protocol):
    """A motion that a controller follows, e.g. `excitation.Multisine`: value and its derivative at a time in s."""

    def value(self, time: float) -> Any: ...
    def rate(self, time: float) -> Any: ...


@dataclass(frozen=True)
class PositionController:
    """PD control as in a cobot joint: position from the link encoder, velocity from the motor encoder.

    torque = k_p (q_ref - q) + k_d (dq_ref - w_m / N), limited to +-limit. The defaults suit Model 2 with its
    nominal parameters (paper Table V) at 500 Hz: the link follows `position_reference()` up to 10 Hz. The limit
    is 150 Nm at the link with a gear ratio of 101, the largest joint torque of a UR5e (its data sheet).

    Attributes:
        k_p: Nm at the motor shaft per rad at the link.
        k_d: Nm s at the motor shaft per rad at the link.
        limit: largest torque at the motor shaft in Nm.
    """

    k_p: float = 12.0
    k_d: float = 0.8
    limit: float = 1.5

    def torque(self, q_ref: float, dq_ref: float, q: float, dq: float, ahead: float = 0.0) -> float:
        """Return the torque at the motor shaft in Nm; `q`: link position in rad, `dq`: motor velocity over N in rad/s.

        `q_ref` and `dq_ref` are the references of the link, in the same units; `ahead` is the torque in Nm that the
        reference is known to need.
        """
        wanted = ahead + self.k_p * (q_ref - q) + self.k_d * (dq_ref - dq)
        return max(-self.limit, min(self.limit, wanted))


class ControlledJoint:
    """A simulated joint under a position controller, advanced by one control period at a time.

    The commanded torque plus white noise acts on the joint, constant over a period. `tick` returns the command, which a
    robot reports as its measured torque. So the noise is not sensor noise but a torque that moves the joint.

    The controller sees what the sensors show. A controller that knew the true state would tell about it through its
    command, which no estimator expects: with torque noise this biases the estimates of long records.

    Attributes:
        joint: the simulated joint.

    Args:
        model: with a link position and driven by a torque or a current at the motor shaft.
        controller: the controller.
        reference: reference of the link position in rad; its time is zero at the start of the simulation.
        values: changes to the nominal parameters.
        x0: start state; default at rest, with motor and link at the reference position.
        torque_noise: standard deviation in Nm at the motor shaft.
        seed: seed of the noise.
        sensors: of the states; by default the controller sees the true state.

    Raises:
        JointIdError: a model without link position or without torque or current input, bad values, negative noise.
    """

    def __init__(
        self,
        model: Model,
        controller: PositionController,
        reference: Reference,
        values: Mapping[str, float] | None = None,
        x0: Mapping[str, float] | None = None,
        torque_noise: float = 0.0,
        seed: int = 0,
        sensors: Sensors | None = None,
    ) -> None:
        drive = model.torque_drive
        if drive is None or "link_position" not in model.state_names:
            raise JointIdError(
                f"model {model.name} cannot be position controlled: it needs a link position as a state and "
                "a torque or current as an input (harmonic_drive, rigid_joint)"
            )
        if not torque_noise >= 0.0:
            raise JointIdError(f"torque_noise = {torque_noise} Nm: must not be negative")
        self._controller, self._reference = controller, reference
        p = model.values(values)
        self._n = model.gear_ratio(p)
        self._drive, self._k_t = drive, model.torque_constant(p)
        self._noise, self._rng = torque_noise, np.random.default_rng(seed)
        if x0 is None:
            q = float(reference.value(0.0))
            x0 = {"link_position": q}
            if "motor_position" in model.state_names:
                x0["motor_position"] = q * self._n
        self.joint = JointSimulator(model, values, x0)
        self._sensors, self._sensor_noise = sensors, np.random.default_rng([seed, 1])
        self._shown: tuple[float, dict[str, float]] = (-math.inf, {})

    @property
    def shown(self) -> dict[str, float]:
        """What the sensors show of the states now."""
        if self._sensors is None:
            return self.joint.state
        if self._shown[0] != self.joint.time:
            seen = {n: float(self._sensors.reading(n, x, self._sensor_noise)) for n, x in self.joint.state.items()}
            self._shown = self.joint.time, seen
        return self._shown[1]

    def change(self, values: Mapping[str, float] | None = None) -> None:
        """Let the joint go on with other parameters; `values` replace the nominal ones.

        The controller does not know: it keeps its gear ratio, and its torque constant for the reported current.

        Raises:
            JointIdError: unknown parameter, a value out of bounds.
        """
        self.joint.change(values)

    def command(self) -> float:
        """Return the torque at the motor shaft in Nm that the controller commands now."""
        t, x = self.joint.time, self.shown
        dq = x["motor_velocity"] / self._n if "motor_velocity" in x else x["link_velocity"]
        return self._controller.torque(
            float(self._reference.value(t)), float(self._reference.rate(t)), x["link_position"], dq
        )

    def tick(self, dt: float) -> dict[str, float]:
        """Hold the present command for `dt` in s; return the reported input as {channel: value}."""
        torque = self.command()
        true = torque + self._noise * self._rng.standard_normal()
        self.joint.advance(dt, {self._drive: true / self._k_t})
        return {self._drive: torque / self._k_t}


def simulate_closed_loop(
    model: Model,
    controller: PositionController,
    reference: Reference,
    time: Array,
    values: Mapping[str, float] | None = None,
    x0: Mapping[str, float] | None = None,
    torque_noise: float = 0.0,
    seed: int = 0,
    sensors: Sensors | None = None,
) -> Recording:
    """Simulate a joint that follows a position reference, one control period per sample; `time` in s, shape (T,).

    The recorded `torque` (or `current`) is the command, held from its sample to the next. The command plus the noise
    acts on the joint. States are recorded as the sensors show them; without `sensors` as they are (`Sensors.measure`
    adds noise that the controller did not see). For further arguments and errors see `ControlledJoint`.
    """
    grid = Recording(time, {}, source=f"closed-loop simulation of {model.name}")
    if len(grid) < 2:
        raise JointIdError(f"{grid.source}: time must hold at least two instants")
    loop = ControlledJoint(model, controller, reference, values, x0, torque_noise, seed, sensors)
    rows = []
    # The last sample has no next one: its command is held for one more period.
    for dt in [*np.diff(grid.time).tolist(), grid.period]:
        shown = loop.shown
        rows.append({**shown, **loop.tick(dt)})
    channels = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    if model.load is not None:
        channels[model.load] = np.zeros(len(grid))
    return Recording(grid.time, channels, source=grid.source)
