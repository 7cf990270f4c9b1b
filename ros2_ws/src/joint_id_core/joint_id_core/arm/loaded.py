"""Recordings of one joint with the load that the rest of the arm puts on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.load_errors import errors_of
from joint_id_core.arm.motion import motion, require_still
from joint_id_core.arm.typical_inertia import typical_inertia
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import LOAD

NEAR = 1.5  # periods to the next sample; a longer step is a gap


@dataclass(frozen=True)
class Loaded:
    """Recordings of one joint whose `external_torque` is the load of the rest of the arm.

    A model of one joint has a constant inertia. So the torque that accelerates the links of the joint stays with the
    model as far as their typical inertia gives it; only what differs from that, as the pose changes, is load.

    Attributes:
        recordings: with the load, as far as the motion of the arm is known; NaN in gaps of other joints.
        inertia: the typical one, in kg m^2: what the estimated inertia contains of the links of the description.
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
            f"holds {self.inertia:.3g} kg m^2 of the links by its masses, the rest is of the rotor."
        )


def loaded(description: Description, joint: str, records: Sequence[Mapping[str, Recording]]) -> Loaded:
    """Add the load of the arm to recordings of a joint.

    Args:
        description: of the robot.
        joint: name of the joint.
        records: recordings, each of all joints by name.

    Raises:
        JointIdError: the joint is not in the description or does not move by itself; a joint of the description was not
            recorded; one that counts as fixed is elsewhere; a recording holds an external torque already, or the arm's
            motion is not known anywhere in it.
    """
    description.require(joint)
    loads = []
    for joints in records:
        require_still(joints, description.still)
        own = joints.get(joint)
        if own is None:
            raise JointIdError(f"no recording of joint {joint}: there are {', '.join(joints)}")
        if LOAD in own:
            raise JointIdError(
                f"{own.source}: joint {joint} has an {LOAD} already: leave the robot's description out, or that channel"
            )
        positions, velocities, accelerations = motion(joints, description.joints, own, description.source)
        load = description.load(joint, positions, velocities, accelerations)
        if not np.isfinite(load.torque).any():
            raise JointIdError(
                f"{own.source}: the joints of the arm were not recorded at the same time: no load is known"
            )
        loads.append((own, load, (positions, velocities, accelerations)))
    k = description.joints.index(joint)
    inertia = float(typical_inertia(description)[k])
    torques = [
        means_over_steps(own.time, load.torque + (load.inertia - inertia) * moved[2][:, k], own.period)
        for own, load, moved in loads
    ]
    errors = errors_of(description)
    if errors is not None and not errors.any_of(joint):
        errors = None
    recordings = tuple(
        replace(
            _known(own, torque), load_errors=None if errors is None else errors.along([joint], own.time, moved)[joint]
        )
        for (own, _, moved), torque in zip(loads, torques, strict=True)
    )
    rms = float(np.sqrt(np.nanmean(np.concatenate(torques) ** 2)))
    return Loaded(recordings, inertia, rms, description.source)


def means_over_steps(time: Array, torque: Array, period: float) -> Array:
    """Return the means of torques (T, ...) over the step after each sample, as a model holds its inputs.

    Without that they would come half a step late, and be taken for damping of the gear. Before a gap, and at the last
    sample, it is the torque of the sample.
    """
    held, near = torque.copy(), np.diff(time) < NEAR * period
    held[:-1][near] = 0.5 * (torque[:-1] + torque[1:])[near]
    return held


def _known(recording: Recording, torque: Array) -> Recording:
    """Return a recording with a load (T,), from the first to the last sample at which it is known."""
    known = np.flatnonzero(np.isfinite(torque))
    return recording.with_channels({LOAD: torque}, derived=True).slice(int(known[0]), int(known[-1]) + 1)
