"""Recordings of one joint with the load that the rest of the arm puts on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.motion import motion
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

LOAD = "external_torque"
NEAR = 1.5  # periods to the next sample; a longer step is a gap
# Errors of the parameters of a flexible joint, as shares of their values, which a fit does not see: vibrations of other
# joints are above the band of a computed load, or below its noise. On a simulated arm of six flexible joints the
# damping of the gear came out 7 to 56 % too large, and of the others one was 1.8 % off, the rest 0.5 % in the mean.
DAMPING_ERROR, ERROR = 0.5, 0.01


@dataclass(frozen=True)
class Loaded:
    """Recordings of one joint whose `external_torque` is the load of the rest of the arm.

    A model of one joint has a constant inertia. So the torque that accelerates the links of the joint stays with the
    model as far as their mean inertia gives it; only what differs from that, as the pose changes, is load.

    Attributes:
        recordings: with the load, as far as the motion of the arm is known; NaN in gaps of other joints.
        inertia: that mean, in kg m^2: what the estimated inertia contains of the links of the description.
        rms: of the load in Nm.
        source: of the description.
    """

    recordings: tuple[Recording, ...]
    inertia: float
    rms: float
    source: str

    @property
    def text(self) -> str:
        """What was done, as a sentence."""
        return (
            f"The load of the rest of the arm, {self.rms:.3g} Nm rms, is from {self.source}; the estimated inertia "
            f"holds {self.inertia:.3g} kg m^2 of the links, the rest is of the rotor."
        )


def loaded(description: Description, joint: str, records: Sequence[Mapping[str, Recording]]) -> Loaded:
    """Add the load of the arm to recordings of a joint.

    Args:
        description: of the robot.
        joint: name of the joint.
        records: recordings, each of all joints by name.

    Raises:
        JointIdError: the joint is not in the description or does not move by itself; a joint of the description was not
            recorded; a recording holds an external torque already, or the arm's motion is not known anywhere in it.
    """
    description.require(joint)
    loads = []
    for joints in records:
        own = joints.get(joint)
        if own is None:
            raise JointIdError(f"no recording of joint {joint}: there are {', '.join(joints)}")
        if own.measured(LOAD):
            raise JointIdError(
                f"{own.source}: joint {joint} has an {LOAD} already: leave the robot's description out, or that channel"
            )
        positions, velocities, accelerations = motion(joints, description.joints, own, description.source)
        load = description.load(joint, positions, velocities, accelerations)
        if not np.isfinite(load.torque).any():
            raise JointIdError(
                f"{own.source}: the joints of the arm were not recorded at the same time: no load is known"
            )
        loads.append((own, load, accelerations[:, description.joints.index(joint)]))
    inertia = float(np.nanmean(np.concatenate([load.inertia for _, load, _ in loads])))
    torques = [_held(own, load.torque + (load.inertia - inertia) * acceleration) for own, load, acceleration in loads]
    recordings = tuple(_known(own, torque) for (own, _, _), torque in zip(loads, torques, strict=True))
    rms = float(np.sqrt(np.nanmean(np.concatenate(torques) ** 2)))
    return Loaded(recordings, inertia, rms, description.source)


def with_doubt(estimate: Estimate, model: Model) -> Estimate:
    """Return an estimate from a recording with a computed load: flexible joints are known less than the fit says."""
    damping = model.gear_damping
    if damping is None:
        return estimate
    rows, scale = {p.name: p for p in estimate.parameters}, np.ones(len(estimate.free))
    for k, name in enumerate(estimate.free):
        share = DAMPING_ERROR if name == damping else ERROR * model.parameter(name).positive
        sigma = float(np.hypot(rows[name].std_dev, share * rows[name].value))
        scale[k] = sigma / rows[name].std_dev
        rows[name] = replace(rows[name], std_dev=sigma)
    if damping in estimate.free:
        told = f"a computed load lacks the vibrations that show it: {100.0 * DAMPING_ERROR:.0f} % of it are doubtful"
        rows[damping] = replace(rows[damping], reason=told)
    covariance = estimate.covariance * np.outer(scale, scale)
    return replace(estimate, parameters=tuple(rows.values()), covariance=covariance)


def _held(recording: Recording, torque: Array) -> Array:
    """Return the means of a torque (T,) over the step after each sample, as a model holds its inputs.

    Without that it would come half a step late, and be taken for damping of the gear.
    """
    held, steps = torque.copy(), np.diff(recording.time)
    near = steps < NEAR * recording.period
    held[:-1][near] = 0.5 * (torque[:-1] + torque[1:])[near]
    return held


def _known(recording: Recording, torque: Array) -> Recording:
    """Return a recording with a load (T,), from the first to the last sample at which it is known."""
    known = np.flatnonzero(np.isfinite(torque))
    return recording.with_channels({LOAD: torque}).slice(int(known[0]), int(known[-1]) + 1)
