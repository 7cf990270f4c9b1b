"""Messages of the action `Identify`: what a motion is to show, and what came out."""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message

from joint_id_core.data.instants import NANO
from joint_id_core.design.design import Design
from joint_id_core.results.estimate import Estimate
from joint_id_msgs.action import Identify
from joint_id_msgs.msg import JointEstimate, JointParams, ParameterEstimate
from joint_id_ros.conversions import VERDICT_CODES
from joint_id_ros.estimate_bytes import ParamsWriter, to_values
from joint_id_ros.identification import Identification


def expected(design: Design, model: str) -> list[Any]:
    """Return what a motion is to show of each joint."""
    joints: dict[str, Any] = {}
    for row in design.expected:
        joint = joints.setdefault(row.joint, JointEstimate(joint=row.joint, model=model, estimator="design"))
        joint.parameters.append(
            ParameterEstimate(
                name=row.name, unit=row.unit, value=row.value, std_dev=row.std_dev, verdict=VERDICT_CODES[row.verdict],
                reason=row.reason,
            )
        )  # fmt: skip
    return list(joints.values())


def result(work: Identification, text: str) -> Any:
    """Return the result of a goal."""
    found = Identify.Result(message=text, bag=str(work.bag or ""), page=str(work.page or ""))
    found.joints = [_message(joint, estimate) for joint, estimate in work.estimates.items()]
    return found


def _message(joint: str, estimate: Estimate) -> Any:
    good = estimate if estimate.converged else None
    data = ParamsWriter().write({joint: to_values(joint, estimate, good, estimate.origin * NANO)})
    return deserialize_message(data, JointParams).joints[0]
