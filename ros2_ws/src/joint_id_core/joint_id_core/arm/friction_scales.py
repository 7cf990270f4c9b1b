"""Friction scales of a UR robot: which share of the friction that its controller reckons with the joints really have.

The controller's `target_current` holds its own model of friction (Universal Robots do not publish it). So the arm is
fitted twice, with the measured current and with the target current as the drive; the ratio of the two frictions is the
scale that brings the model to the joint. An error that all torque constants share cancels. `direct_torque` of URScript
takes such scales, one of viscous and one of Coulomb friction a joint, 0 to 1 (Universal Robots, Script Manual 5.25),
and so does the controller `friction_model_controller` of their ROS driver.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from joint_id_core.arm.arm_estimate import JointValues, Value
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import DRIVES
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.rests import LEAST_R_SQUARED
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import Verdict

JOINTS = 6
# By kind of friction: what the driver calls its scale, and what the controller takes without one.
SCALES = {
    "damping": ("viscous_scale", (0.9, 0.9, 0.8, 0.9, 0.9, 0.9)),
    "friction": ("coulomb_scale", (0.8, 0.8, 0.7, 0.8, 0.8, 0.8)),
}
INTERVAL = 1.959964  # standard deviations: 95 %
SERVICE = "/friction_model_controller/set_friction_model_parameters"
TYPE = "ur_msgs/srv/SetFrictionModelParameters"
HEAD = """\
# Friction scales of direct torque control, 0 to 1, of a UR robot. Nothing was sent to it.
# Each is the lower end of the 95 % interval of measured over modelled friction: too much makes a joint move by itself.
# They hold if direct torque control reckons with the friction that is in the recorded target current, which Universal
# Robots do not say, and near the temperature of the recording. Begin with less, and watch the robot.\
"""


@dataclass(frozen=True)
class Scale:
    """Measured friction of a joint over that of its controller's model.

    Attributes:
        ratio, std_dev: of them; NaN where the recording does not show it.
        reason: why it does not; empty if it does.
        usual: what the controller takes without a scale.
    """

    ratio: float
    std_dev: float
    reason: str
    usual: float

    @property
    def offered(self) -> float:
        """The scale to set: the lower end of the 95 % interval, as too much makes a joint move by itself; 0 to 1."""
        if self.reason:
            return self.usual
        return min(1.0, max(0.0, self.ratio - INTERVAL * self.std_dev))

    def __str__(self) -> str:
        """Return it as text."""
        return f"{self.offered:.2f}   " + (self.reason or f"{self.ratio:.3f} ± {self.std_dev:.2g}")


@dataclass(frozen=True)
class FrictionScales:
    """Scales of all joints, from the base.

    Attributes:
        joints: their names.
        scales: by the driver's name of the scale, one a joint.
        doubts: what the checks of the recordings found.
    """

    joints: tuple[str, ...]
    scales: Mapping[str, tuple[Scale, ...]]
    doubts: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the scales as text, with the calls that set them: comments, and one line of a shell."""
        width = max(map(len, self.joints)) + 2
        lines = [HEAD]
        for name, scales in self.scales.items():
            lines.append(f"# {name:<{width + 2}}scale  measured over modelled")
            lines += [f"#   {j:<{width}}{s}" for j, s in zip(self.joints, scales, strict=True)]
        lines += [f"# doubtful: {text}" for text in self.doubts]
        listed = {name: [round(s.offered, 2) for s in scales] for name, scales in self.scales.items()}
        script = ", ".join(f"{name}={values}" for name, values in listed.items())
        sent = ", ".join(f"{name}: {values}" for name, values in listed.items())
        lines += [
            f"# URScript, PolyScope 5.25 or 10.12: direct_torque(torque, {script})",
            f'ros2 service call {SERVICE} {TYPE} "{{parameters: {{{sent}}}}}"',
        ]
        return "\n".join(lines)


def friction_scales(
    description: Description, records: Sequence[Mapping[str, Recording]], gains: Gains
) -> FrictionScales:
    """Find them.

    Args:
        description: of the robot.
        records: recordings, each of all joints by name, with link position, current and target current.
        gains: by joint and drive, the torque at the link in Nm of one unit of it; see `fit_arm`.

    Raises:
        JointIdError: as `fit_arm`; not six joints; no current, or no target current, of a joint.
    """
    if len(description.joints) != JOINTS:
        raise JointIdError(f"{description.source} has {len(description.joints)} joints: a UR robot has {JOINTS}")
    driven = {name: [_driven_by(name, record) for record in records] for name in ("current", "target_current")}
    measured, modelled = (fit_arm(description, some, gains) for some in driven.values())
    scales = {
        name: tuple(
            _scale(one, model, quantity, own)
            for one, model, own in zip(measured.joints, modelled.joints, usual, strict=True)
        )
        for quantity, (name, usual) in SCALES.items()
    }
    return FrictionScales(tuple(description.joints), scales, measured.doubts)


def _driven_by(name: str, record: Mapping[str, Recording]) -> dict[str, Recording]:
    """Return recordings whose only drive is the channel of this name, as a current."""
    found = {}
    for joint, recording in record.items():
        if not recording.measured(name):
            raise JointIdError(
                f"{recording.source}: joint {joint} has no {name}: record actual_current and target_current of RTDE "
                "(extra_fields of the driver: target_current)"
            )
        others = {n: v for n, v in recording.channels.items() if n not in (*DRIVES, "target_current")}
        found[joint] = replace(recording, channels={**others, "current": recording[name]})
    return found


def _scale(measured: JointValues, modelled: JointValues, quantity: str, usual: float) -> Scale:
    """Return the scale of one joint, from both of its fits."""
    found: tuple[Value, Value] = (getattr(measured, quantity), getattr(modelled, quantity))
    for joint, value, what in zip((measured, modelled), found, ("measured", "modelled"), strict=True):
        if value.verdict is not Verdict.ESTIMATED:
            return Scale(
                math.nan, math.nan, f"that of Universal Robots: the {what} friction is {value.verdict.value}", usual
            )
        if not joint.r_squared > LEAST_R_SQUARED:
            return Scale(math.nan, math.nan, f"that of Universal Robots: the {what} torque is not explained", usual)
    ratio = found[0].value / found[1].value
    return Scale(ratio, ratio * math.hypot(*(value.std_dev / value.value for value in found)), "", usual)
