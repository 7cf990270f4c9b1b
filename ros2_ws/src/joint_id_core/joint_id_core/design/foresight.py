"""What a fit of a planned motion will tell: the information of the engine's own filter, before anything moves.

The motion is simulated as the joint's controller makes it, measured as the robot's sensors do, and passed once through
the filter of the innovations estimator at the true parameters and noise levels. The Gauss-Newton matrix there is the
Fisher information (Ljung, System Identification, 2nd ed., section 7.4), to which the estimator adds its prior, the
uncertainty of the noise levels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from joint_id_core.cell.kernel import Kernel, compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.plant import (
    LOADS,
    SHARP,
    SHARPER,
    Moved,
    Plant,
    as_recorded,
    controller_of,
    plant_of,
    sensors_of,
)
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.checks import in_combination
from joint_id_core.estimators.innovations.gauss_newton import Cost
from joint_id_core.estimators.innovations.input_noise import sensor_bias, with_motion_noise
from joint_id_core.estimators.innovations.noise import NoiseLevels, unknown_levels
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.innovations.verdicts import Shown, verdicts
from joint_id_core.estimators.shared.fit_data import FitData, prepare
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.substeps import stable_substeps, steps_of
from joint_id_core.models import Model
from joint_id_core.simulation.sensors import UR_CHANNELS, Sensors

GUESS = 0.1  # by which the start values are off, as a standard deviation of the logarithm; less if the prior says so
ACCURATE = 2  # times the integrator steps that are stable: estimators refine theirs, too


@dataclass(frozen=True)
class Seen:
    """What one motion of one joint tells.

    Attributes:
        covariance: of the estimation coordinates, shape (k, k), prior included.
        torque: largest torque of the drive, at the link, in Nm.
    """

    covariance: Array
    torque: float


class Foresight:
    """What fits of planned motions of one joint will tell.

    Args:
        model: that will be fitted.
        settings: of the fit. The values are what is believed of the joint; of `motor_side` also those of the link.
        rate: of control and recording in Hz.
        sensors: of the robot; None takes those of a UR robot.

    Raises:
        JointIdError: a model that no controller can move; see `ParameterSettings.applied_to`.
    """

    def __init__(
        self, model: Model, settings: ParameterSettings, rate: float = 500.0, sensors: Sensors | None = None
    ) -> None:
        plant = plant_of(model)
        own = [name for name in settings.values if name in plant.parameter_names and name not in model.parameter_names]
        for name in settings.names:
            if name not in own:
                model.parameter(name)
        self.model, self.rate, self.settings = model, rate, settings.of(model)
        self._link = {name: settings.values[name] for name in own}
        start, self.free = self.settings.applied_to(model)
        self.values = dict(zip(model.parameter_names, start.tolist(), strict=True))
        self.coordinates = Coordinates(model, self.free, self.settings.priors)
        self.link = plant.values({**{n: v for n, v in self.values.items() if n in plant.parameter_names}, **self._link})
        self.plant = Plant(plant, controller_of(plant, self.link))
        self.sensors = sensors or sensors_of(model, self.values)

    @property
    def measured(self) -> tuple[str, ...]:
        """Channels that the robot records of this joint."""
        return tuple(n for n in UR_CHANNELS if n in self.plant.model.state_names or n == self.plant.model.torque_drive)

    @cached_property
    def _kernel(self) -> Kernel:
        return compile_model(self.model, "tanh", self.settings.freed_in(self.model))

    def joints(self, pairs: int, seed: int = 0) -> list[dict[str, float]]:
        """Return the values of all parameters, the link's too, of joints that are as likely as the start values.

        The first joint has the start values. Each pair is off by the same amount up and down, so that no draw leans to
        one side: the logarithms of positive parameters by `GUESS`, or by the prior where that is less.
        """
        found, rng = [self.link | self.values], np.random.default_rng(seed)
        rows = {p.name: p for p in (*self.plant.model.parameters, *self.model.parameters)}
        moved = [p for p in rows.values() if p.positive and not (p.fixed or p.name in self.settings.fixed)]
        spreads = [min(GUESS, self.settings.priors.get(p.name, p.spread)) for p in moved]
        for _ in range(pairs):
            off = np.array(spreads) * rng.standard_normal(len(moved))
            for side in (1.0, -1.0):
                joint = dict(found[0])
                for p, by in zip(moved, off.tolist(), strict=True):
                    joint[p.name] = min(max(joint[p.name] * float(np.exp(side * by)), p.lower), p.upper)
                found.append(joint)
        return found

    def see(self, joint: Mapping[str, float], position: Array, velocity: Array) -> Seen:
        """Return what the motion (T,) of the link, in rad and rad/s, tells of a joint with these values.

        Raises:
            UnusableError: the motion is too short or too small for a fit.
            JointIdError: the simulation or the filter does not stay finite.
        """
        moved = self.move(joint, position, velocity, SHARP)
        return Seen(self.covariance(joint, moved.recording), moved.torque)

    def move(
        self, joint: Mapping[str, float], position: Array, velocity: Array, sharper: float = SHARPER
    ) -> Moved:  # fmt: skip
        """Let a joint with these values follow the motion (T,) of its link; errors as `see`."""
        values = {name: joint[name] for name in self.plant.model.parameter_names}
        return self.plant.follow(values, position, velocity, 1.0 / self.rate, sharper)

    def covariance(self, joint: Mapping[str, float], exact: Recording) -> Array:
        """Return the covariance of the coordinates, (k, k), that a fit of a motion will have near these values.

        The bias from smoothed friction and from noise of the drive's sensor counts as uncertain. It is the Newton step
        at the true values, averaged over sensor noise of both signs, which leaves only what is even in the noise.
        """
        both = self.recordings(exact)
        # what a fit takes off is even in the noise, too: one sign tells it
        seen = [self.informed(joint, recording, taken_off=recording is both[0]) for recording in both]
        covariance = sum(c for c, _, _ in seen) / 2.0
        bias = sum(step for _, step, _ in seen) / 2.0 - seen[0][2]
        bias = np.clip(bias, -self.coordinates.spread, self.coordinates.spread)
        return np.asarray(covariance + np.outer(bias, bias))

    def recordings(self, exact: Recording) -> tuple[Recording, Recording]:
        """Return what the robot records of a motion, with sensor noise of both signs."""
        recording = as_recorded(exact, self.sensors)
        opposite = {name: 2.0 * exact[name] - recording[name] for name in recording.channels}
        return recording, replace(recording, channels=opposite)

    def verdicts(self, covariance: Array, position: Array, velocity: Array) -> dict[str, Shown]:
        """Return the verdict on every parameter by the rules of the estimator, for a covariance (k, k) of a motion."""
        joint = self.joints(0)[0]
        data, _, _ = self.prepared(joint, self.recordings(self.move(joint, position, velocity).recording)[0])
        z = self.coordinates.z(np.array([self.values[name] for name in self.free]))
        slope = self.coordinates.slope(z)
        together = in_combination(data, data.p, covariance * np.outer(slope, slope))
        return verdicts(self.model, self.free, covariance, self.coordinates, z, together)

    def prepared(self, joint: Mapping[str, float], recording: Recording) -> tuple[FitData, Array, int]:
        """Return a recording as a fit takes it that starts from the true values, noise variances and steps a sample."""
        truth = {name: joint[name] for name in self.model.parameter_names}
        settings = ParameterSettings(truth, self.settings.fixed, self.settings.freed, self.settings.priors)
        data = prepare(self.model, recording, settings, leave_out_rests=True)
        substeps = stable_substeps(data, self._kernel, data.p, rough_states(data), sliding=True)
        return data, levels_of(data, self.sensors), substeps

    def informed(
        self,
        joint: Mapping[str, float],
        recording: Recording,
        taken_off: bool = False,
        noise: Mapping[str, float] | None = None,
    ) -> tuple[Array, Array, Array]:
        """Return the covariance near the true values, the Newton step from there, and the bias that a fit takes off.

        Without `taken_off` the last one is zero. `noise` holds the noise levels of a fit; None: those of the sensors.
        """
        data, levels, stable = self.prepared(joint, recording)
        if noise is not None:
            levels = np.square([noise[name] for name in data.noise_names])
        coordinates, kernel, substeps = self.coordinates, self._kernel, ACCURATE * stable
        loaded = any(joint.get(name, 0.0) != 0.0 for name in LOADS)
        recursion = Recursion(data, kernel, data.p if loaded else None)
        cost = Cost(recursion, coordinates, Belief.before_data(data, coordinates))
        steps = steps_of(data, kernel, data.p, rough_states(data), substeps)
        found = cost.at(cost.belief.mean, levels, steps, substeps)
        if found is None or not found.definite:
            raise JointIdError(f"model {self.model.name}: the filter does not follow this motion with these parameters")
        known = recursion.noise_information(found.last, with_parameters=True)
        cross = known.cross * coordinates.slope(found.z)[:, None]
        covariance = found.inverse + unknown_levels(found.inverse, known.matrix, cross)
        step, noisy = found.inverse @ found.gradient, []
        if taken_off:
            noisy = with_motion_noise(recursion, found, found.last)
        return covariance, step, sensor_bias(noisy, coordinates, found, found.last)


def levels_of(data: FitData, sensors: Sensors) -> Array:
    """Return the noise variances that a fit will find, shape (labels + inputs,): those of the sensors.

    An input that is computed from a measured one gets the largest variance that its own noise shows, where fits end;
    that is not measured gets none.
    """
    bounds, variances = NoiseLevels.of(data), []
    for name, lower, upper in zip((*data.labels, *data.model.input_names), bounds.lower, bounds.upper, strict=True):
        if data.recording.measured(name) and name in sensors.noise:
            variances.append(sensors.noise[name] ** 2 + sensors.quantum.get(name, 0.0) ** 2 / 12.0)
        else:
            variances.append(float(upper if name in data.recording else lower))
    return bounds.clip(np.array(variances))
