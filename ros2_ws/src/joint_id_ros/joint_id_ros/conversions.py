"""Between ROS messages and the core's types. Every message is checked here and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import MEASURED_BITS, SAMPLES, Topic
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_msgs.msg import JointEstimate, JointSamples, ParameterEstimate

NANO = 10**9

STATUS_CODES = {status: getattr(JointEstimate, status.name) for status in Status}
VERDICT_CODES = {verdict: getattr(ParameterEstimate, verdict.name) for verdict in Verdict}

Row = dict[str, float]  # value by channel


def nanoseconds(stamp: Any) -> int:
    """Instant of a stamp in ns."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def to_stamp(instant_ns: int) -> Time:
    """Stamp of an instant in ns."""
    return Time(sec=instant_ns // NANO, nanosec=instant_ns % NANO)


def seconds(instant_ns: int, origin_ns: int) -> float:
    """Time since an origin in s; near zero, so that a double keeps every nanosecond of a day."""
    return (instant_ns - origin_ns) / NANO


def instant(time_s: float, origin_ns: int) -> int:
    """Inverse of `seconds`; the origin for a time that is not known."""
    return origin_ns + (round(time_s * NANO) if math.isfinite(time_s) else 0)


def check(topic: Topic, message: Any) -> None:
    """Check a message of one of our topics.

    Raises:
        JointIdError: no joint, a joint twice, an array as long as neither 0 nor the joints, an infinite value.
    """
    names = message.name
    if not names:
        raise JointIdError(f"{topic.name}: a message names no joint: fill the field 'name' when publishing")
    if len(set(names)) < len(names):
        raise JointIdError(f"{topic.name}: a message names a joint twice ({', '.join(names)}): mend the publisher")
    for field in topic.fields:
        values = getattr(message, field)
        if len(values) not in (0, len(names)):
            raise JointIdError(
                f"{topic.name}: {len(values)} values of {field} for {len(names)} joints: give one a joint or none"
            )
        for name, value in zip(names, values, strict=False):
            if math.isinf(value):
                raise JointIdError(f"{topic.name}: {field} of joint {name} is infinite: use NaN for a missing value")


def rows(topic: Topic, message: Any) -> dict[str, Row]:
    """Values by joint and channel of a raw message that passed `check`; empty arrays are not measured."""
    arrays = [(channel, getattr(message, field)) for field, channel in topic.fields.items()]
    arrays = [(channel, values) for channel, values in arrays if len(values)]
    return {name: {channel: values[i] for channel, values in arrays} for i, name in enumerate(message.name)}


def to_samples(
    instant_ns: int, joints: Sequence[str], channels: Mapping[str, np.ndarray], derived: Collection[str]
) -> JointSamples:
    """Samples of all joints at one instant; a channel has shape (joints,)."""
    message = JointSamples(name=list(joints))
    message.header.stamp = to_stamp(instant_ns)
    for name, values in channels.items():
        setattr(message, name, values.tolist())
    message.measured = sum(MEASURED_BITS[name] for name in channels if name not in derived)
    return message


def to_recordings(messages: Sequence[JointSamples], origin_ns: int, source: str) -> dict[str, Recording]:
    """One recording a joint, time in s since the origin, of messages in order of their stamps that passed `check`.

    A channel counts as derived when any of the messages says so, and is left out when it has no value.
    """
    times: dict[str, list[float]] = {}
    columns: dict[str, dict[str, list[float]]] = {}
    derived: dict[str, set[str]] = {}
    for message in messages:
        time = seconds(nanoseconds(message.header.stamp), origin_ns)
        arrays = [(channel, getattr(message, channel)) for channel in SAMPLES.fields]
        unmeasured = [c for c, values in arrays if len(values) and not message.measured & MEASURED_BITS[c]]
        for i, joint in enumerate(message.name):
            column = columns.setdefault(joint, {channel: [] for channel, _ in arrays})
            times.setdefault(joint, []).append(time)
            for channel, values in arrays:
                column[channel].append(values[i] if len(values) else math.nan)
            derived.setdefault(joint, set()).update(unmeasured)
    recordings = {}
    for joint, column in columns.items():
        known = {c: np.array(values) for c, values in column.items() if any(v == v for v in values)}
        marks = frozenset(derived[joint] & set(known))
        recordings[joint] = Recording(np.array(times[joint]), known, marks, source=source, joint=joint)
    return recordings


def to_estimate_message(joint: str, estimate: Estimate, origin_ns: int) -> JointEstimate:
    """Message of an estimate whose times count from the origin."""
    signals = sorted({*estimate.nrmse, *estimate.noise})
    return JointEstimate(
        joint=joint,
        model=estimate.model,
        estimator=estimate.estimator,
        window_start=to_stamp(instant(estimate.start, origin_ns)),
        window_end=to_stamp(instant(estimate.end, origin_ns)),
        samples=estimate.samples,
        status=STATUS_CODES[estimate.status],
        message=estimate.message,
        parameters=[
            ParameterEstimate(
                name=p.name,
                unit=p.unit,
                value=p.value,
                std_dev=p.std_dev,
                verdict=VERDICT_CODES[p.verdict],
                reason=p.reason,
            )
            for p in estimate.parameters
        ],
        free=list(estimate.free),
        covariance=estimate.covariance.ravel().tolist(),
        signal=signals,
        nrmse=[estimate.nrmse.get(name, math.nan) for name in signals],
        noise_std=[estimate.noise.get(name, math.nan) for name in signals],
        chi2=estimate.chi2,
        substeps=estimate.substeps,
        iterations=estimate.iterations,
        solve_time=estimate.elapsed_s,
    )


def to_truth_message(joint: str, model: Model, values: Mapping[str, float], since_ns: int) -> JointEstimate:
    """Message of values that are known, as those of a simulation."""
    rows = [
        ParameterEstimate(name=p.name, unit=p.unit, value=values[p.name], verdict=ParameterEstimate.FIXED)
        for p in model.parameters
    ]
    stamp = to_stamp(since_ns)
    return JointEstimate(
        joint=joint, model=model.name, estimator="truth", window_start=stamp, window_end=stamp,
        status=JointEstimate.CONVERGED, message="values of the simulation", parameters=rows,
    )  # fmt: skip
