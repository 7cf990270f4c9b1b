"""Convert between ROS messages and the core's types, and check messages."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from joint_id_core.data.instants import NANO
from joint_id_core.data.signals import LARGEST
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import Topic
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.results.estimate import ParameterEstimate as CoreParameter
from joint_id_msgs.msg import JointEstimate, ParameterEstimate

STATUS_CODES = {status: getattr(JointEstimate, status.name) for status in Status}
VERDICT_CODES = {verdict: getattr(ParameterEstimate, verdict.name) for verdict in Verdict}


def nanoseconds(stamp: Any) -> int:
    """Return the instant of a stamp in ns."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def to_stamp(instant_ns: int) -> Time:
    """Return the stamp of an instant in ns."""
    return Time(sec=instant_ns // NANO, nanosec=instant_ns % NANO)


def check_message(topic: Topic, message: Any) -> None:
    """Check a message of one of joint_id's topics.

    Raises:
        JointIdError: an invalid stamp, no joint, a joint that occurs twice, no value at all, an array that is neither
            empty nor as long as the list of joints, a value that is infinite or impossibly large.
    """
    names, stamp = message.name, message.header.stamp
    if stamp.sec < 0 or stamp.nanosec >= NANO:
        raise JointIdError(f"{topic.name}: a stamp of {stamp.sec} s, {stamp.nanosec} ns is no time: mend the publisher")
    if not names:
        raise JointIdError(f"{topic.name}: a message names no joint: fill the field 'name' when publishing")
    if len(set(names)) < len(names):
        raise JointIdError(f"{topic.name}: a message names a joint twice ({', '.join(names)}): mend the publisher")
    arrays = {field: getattr(message, field) for field in topic.fields}
    if not any(map(len, arrays.values())):
        raise JointIdError(f"{topic.name}: a message holds no values: fill at least one of {', '.join(arrays)}")
    for field, values in arrays.items():
        if len(values) not in (0, len(names)):
            raise JointIdError(
                f"{topic.name}: {len(values)} values of {field} for {len(names)} joints: give one a joint or none"
            )
        for name, value in zip(names, values, strict=False):
            if abs(value) > LARGEST:  # false for NaN
                what = "infinite" if math.isinf(value) else f"{value:.3g}, which no joint can have"
                raise JointIdError(f"{topic.name}: {field} of joint {name} is {what}: use NaN for a missing value")


def to_truth_message(joint: str, model: Model, values: Mapping[str, float], since_ns: int) -> JointEstimate:
    """Return the message of known parameter values, such as those of a simulation."""
    rows = [
        ParameterEstimate(name=p.name, unit=p.unit, value=values[p.name], verdict=ParameterEstimate.FIXED)
        for p in model.parameters
    ]
    stamp = to_stamp(since_ns)
    return JointEstimate(
        joint=joint, model=model.name, estimator="truth", message="values of the simulation",
        window_start=stamp, window_end=stamp, status=JointEstimate.CONVERGED,
        parameters_start=stamp, parameters_end=stamp, parameters_status=JointEstimate.CONVERGED, parameters=rows,
        temperature=math.nan,
    )  # fmt: skip


def to_estimate(message: JointEstimate) -> Estimate:
    """Return the estimate of a message, with times in s of the epoch; what a message does not hold is empty.

    Status and message are those of the newest window, parameters those of the newest good one.
    """
    verdicts = {code: verdict for verdict, code in VERDICT_CODES.items()}
    statuses = {code: status for status, code in STATUS_CODES.items()}
    rows = tuple(
        CoreParameter(p.name, p.unit, p.value, p.std_dev, verdicts[p.verdict], reason=p.reason)
        for p in message.parameters
    )
    count = len(message.free)
    signals = list(message.signal)
    return Estimate(
        model=message.model, estimator=message.estimator, status=statuses[message.status], message=message.message,
        parameters=rows, free=tuple(message.free), covariance=np.array(message.covariance).reshape(count, count),
        nrmse={n: v for n, v in zip(signals, message.nrmse, strict=True) if not math.isnan(v)},
        noise={n: v for n, v in zip(signals, message.noise_std, strict=True) if not math.isnan(v)},
        chi2=message.chi2, substeps=message.substeps, iterations=message.iterations, elapsed_s=message.solve_time,
        start=nanoseconds(message.parameters_start) / NANO, end=nanoseconds(message.parameters_end) / NANO,
        samples=message.samples, source="/joint_params", joint=message.joint, temperature=message.temperature,
        notes=(message.message,) if message.message else (),
    )  # fmt: skip
