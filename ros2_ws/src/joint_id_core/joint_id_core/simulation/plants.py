"""The simulated joints of the node `sim`: model and drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from joint_id_core.errors import JointIdError
from joint_id_core.models import Electromechanical, HarmonicDrive, Model
from joint_id_core.options import check, option
from joint_id_core.simulation.excitation import STEP_S, STEPS_V, position_reference
from joint_id_core.simulation.position_control import ControlledJoint, PositionController
from joint_id_core.simulation.simulator import JointSimulator


@dataclass(frozen=True)
class MotionOptions:
    """Options of the motion."""

    steps_v: tuple[float, ...] = option(STEPS_V, "electromechanical: voltage steps, repeated", "V")
    step_s: float = option(STEP_S, "electromechanical: duration of a step", "s", 1e-3, 1e3)
    amplitude: float = option(0.4, "harmonic_drive: peak of the reference of the link position", "rad", 0.0, 3.0)

    def __post_init__(self) -> None:
        check(self)
        if not self.steps_v:
            raise JointIdError("parameter steps_v is empty: give at least one voltage")


class Plant(Protocol):
    """A simulated joint that moves."""

    model: Model
    values: dict[str, float]

    def tick(self, dt: float) -> dict[str, float]:
        """Return the true states and the inputs now, by channel; then hold these inputs and advance by `dt` in s.

        Raises:
            JointIdError: the simulation cannot go on.
        """

    def change(self, values: Mapping[str, float]) -> None:
        """Go on from the present state with other parameters: a load is picked up, a gear wears.

        `values` replace all that were given before: a parameter that they do not name gets its default.

        Raises:
            JointIdError: unknown parameter, a value out of bounds.
        """


class StepResponses:
    """Model 3 under repeated voltage steps; if the steps sum to zero, the position stays bounded."""

    def __init__(self, values: Mapping[str, float], motion: MotionOptions, seed: int) -> None:
        self.model: Model = Electromechanical()
        self.values = self.model.values(values)
        self._motion = motion
        self._joint = JointSimulator(self.model, self.values)

    def tick(self, dt: float) -> dict[str, float]:
        steps = self._motion.steps_v
        inputs = {"voltage": steps[int(self._joint.time / self._motion.step_s + 1e-6) % len(steps)]}
        row = {**self._joint.state, **inputs}
        self._joint.advance(dt, inputs)
        return row

    def change(self, values: Mapping[str, float]) -> None:
        self._joint.change(values)
        self.values = self.model.values(values)


class PositionControl:
    """Model 2 with a position controller that follows a multisine. It is driven by a current, which it reports."""

    MODEL = HarmonicDrive.name
    # The paper's Model 2 is driven by a torque. The torque constant of Model 3 converts the current to this torque.
    K_T = Electromechanical().parameter("k_t").nominal

    def __init__(self, values: Mapping[str, float], motion: MotionOptions, seed: int) -> None:
        self.model: Model = HarmonicDrive(actuation="current")
        self.values = self._all(values)
        reference = position_reference(motion.amplitude)
        self._loop = ControlledJoint(self.model, PositionController(), reference, self.values, seed=seed)

    def tick(self, dt: float) -> dict[str, float]:
        return {**self._loop.joint.state, **self._loop.tick(dt)}

    def change(self, values: Mapping[str, float]) -> None:
        self._loop.change(self._all(values))
        self.values = self._all(values)

    def _all(self, values: Mapping[str, float]) -> dict[str, float]:
        return self.model.values({"k_t": self.K_T, **values})


PLANTS: dict[str, type[StepResponses] | type[PositionControl]] = {
    Electromechanical.name: StepResponses,
    HarmonicDrive.name: PositionControl,
}
