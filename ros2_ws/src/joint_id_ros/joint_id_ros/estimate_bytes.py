"""Estimates in the bytes of JointParams, as they travel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from joint_id_core.data.instants import NANO, instant, seconds
from joint_id_core.formats.cdr_writer import BEGIN, Fields, PartWriter
from joint_id_core.online.drift import Drift
from joint_id_core.results.estimate import Estimate, Status
from joint_id_msgs.msg import JointEstimate, ParameterDrift, ParameterEstimate
from joint_id_ros.conversions import STATUS_CODES, VERDICT_CODES
from joint_id_ros.message_types import message_class

Values = tuple[Any, ...]  # of the fields of a message, in their order; those of nested messages are such tuples

FIELDS: Fields = JointEstimate.get_fields_and_field_types()
WINDOW_END = list(FIELDS).index("window_end")
VERDICT = list(ParameterEstimate.get_fields_and_field_types()).index("verdict")
DRIFT_TEXT = list(ParameterDrift.get_fields_and_field_types()).index("text")


def to_values(
    joint: str, newest: Estimate, good: Estimate | None, origin_ns: int, drifts: Sequence[Drift] = ()
) -> Values:
    """Return the values of a JointEstimate of the newest fit and the newest good one (None if there is none).

    Where two estimators disagree, the parameters are those of the newest fit: their intervals contain both. Times count
    from the origin, those of the drifts as well.
    """
    found = newest if good is None or newest.status is Status.DISAGREE else good
    signals = sorted({*newest.nrmse, *newest.noise})
    end_ns, found_end_ns = instant(newest.end, origin_ns), instant(found.end, origin_ns)
    return (
        joint,
        newest.model,
        newest.estimator,
        divmod(instant(newest.start, origin_ns), NANO),
        divmod(end_ns, NANO),
        newest.samples,
        STATUS_CODES[newest.status],
        newest.message,
        signals,
        [newest.nrmse.get(name, math.nan) for name in signals],
        [newest.noise.get(name, math.nan) for name in signals],
        newest.chi2,
        newest.substeps,
        newest.iterations,
        newest.elapsed_s,
        STATUS_CODES[found.status],
        divmod(instant(found.start, origin_ns), NANO),
        divmod(found_end_ns, NANO),
        found.temperature,
        seconds(end_ns, found_end_ns),
        [(p.name, p.unit, p.value, p.std_dev, VERDICT_CODES[p.verdict], p.reason) for p in found.parameters],
        found.free,
        found.covariance.ravel().tolist(),
        [
            (c.name, c.before, c.before_std_dev, c.after, c.after_std_dev, divmod(instant(c.since, origin_ns), NANO))
            for c in found.changes if c.sure
        ],
        [
            (d.name, d.unit, d.baseline, d.value, d.std_dev, d.confidence,
             divmod(instant(d.since, origin_ns), NANO), d.warmer, d.text)
            for d in drifts
        ],
    )  # fmt: skip


def by_field(values: Values) -> dict[str, Any]:
    """Return the values of a JointEstimate by field; those of nested messages are tuples."""
    return dict(zip(FIELDS, values, strict=True))


class ParamsWriter:
    """Writes messages of JointParams."""

    def __init__(self) -> None:
        self._head = PartWriter({"header": "std_msgs/Header", "joints": "uint32"}, _fields)
        self._joints: dict[str, PartWriter] = {}

    def write(self, estimates: Mapping[str, Values]) -> bytes:
        """Return the message of the estimates of all joints; its stamp is the newest end of a window."""
        stamp = max((values[WINDOW_END] for values in estimates.values()), default=(0, 0))
        data = bytearray(self._head.write(((stamp, ""), len(estimates))))
        for joint in sorted(estimates):
            if joint not in self._joints:
                self._joints[joint] = PartWriter(FIELDS, _fields)
            data += self._joints[joint].write(estimates[joint], len(data))
        return BEGIN + data


def _fields(name: str) -> Fields:
    """Return the fields of a type such as "std_msgs/Header"."""
    fields: Fields = message_class(name.replace("/", "/msg/")).get_fields_and_field_types()
    return fields
