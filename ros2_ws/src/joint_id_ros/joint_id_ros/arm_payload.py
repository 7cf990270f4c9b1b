"""The message of what an arm carries."""

from __future__ import annotations

import math

from joint_id_core.arm.changes import PAYLOAD
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.joint_estimates import payload, payload_text
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.instants import instant
from joint_id_msgs.msg import ArmPayload, ParameterEstimate
from joint_id_ros.conversions import to_stamp


def to_payload(follower: ArmFollower, regressor: Regressor, origin_ns: int) -> ArmPayload:
    """Return the message; times of the follower count from `origin_ns`."""
    message = ArmPayload(link=regressor.last_link, message=payload_text(follower, regressor))
    message.header.stamp = to_stamp(origin_ns if math.isnan(follower.time) else instant(follower.time, origin_ns))
    if follower.belief is None:
        return message
    if PAYLOAD in follower.changes:
        message.since = to_stamp(instant(follower.changes[PAYLOAD].since, origin_ns))
    message.verdict, message.carries = ParameterEstimate.ESTIMATED, follower.belief.carries
    found = payload(follower, regressor)
    if found is not None:
        message.verdict = ParameterEstimate.ESTIMATED if found.known else ParameterEstimate.PRIOR
        message.mass, message.mass_std_dev = found.mass, found.mass_std_dev
        message.centre, message.centre_std_dev = found.centre, found.centre_std_dev
    return message
