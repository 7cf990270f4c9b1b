"""The rows of the table: what is known of one joint from one recording."""

from __future__ import annotations

import math
from typing import Any

from joint_id_core.batch.recordings import Found
from joint_id_core.results.estimate import Estimate

Row = dict[str, Any]
ERROR = "error"  # status of a recording or a joint that could not be read or fitted
CRASHED = "crashed"  # ... whose process ended
FAILED = (ERROR, CRASHED)
MARK = b"joint_id"  # key of the table's metadata
VERSION = b"batch 1"


def schema() -> Any:
    """Return the columns of the table (`pyarrow.Schema`); docs/tutorials/batch.md says what is in them."""
    import pyarrow as pa

    text, number, whole = pa.string(), pa.float64(), pa.int64()
    parameter = pa.struct(
        [("name", text), ("unit", text), ("value", number), ("std_dev", number), ("verdict", text), ("reason", text)]
    )
    columns = [
        ("recording", text), ("robot", text), ("joint", text),
        ("status", text), ("message", text), ("warnings", pa.list_(text)),
        ("model", text), ("model_options", text), ("estimator", text),
        ("parameters", pa.list_(parameter)), ("free", pa.list_(text)), ("covariance", pa.list_(number)),
        ("temperature_deg_c", number), ("start_s", number), ("end_s", number), ("samples", whole), ("chi2", number),
        ("elapsed_s", number), ("size_bytes", whole), ("modified", text), ("options", text), ("versions", text),
    ]  # fmt: skip
    return pa.schema(columns, metadata={MARK: VERSION})


def row_of_estimate(estimate: Estimate, model_options: str) -> Row:
    """Return the columns that an estimate fills."""
    return {
        "status": estimate.status.value,
        "message": estimate.message,
        "model": estimate.model,
        "model_options": model_options,
        "estimator": estimate.estimator,
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "value": _number(p.value),
                "std_dev": _number(p.std_dev),
                "verdict": p.verdict.value,
                "reason": p.reason,
            }
            for p in estimate.parameters
        ],
        "free": list(estimate.free),
        "covariance": [_number(v) for v in estimate.covariance.ravel().tolist()],
        "temperature_deg_c": _number(estimate.temperature),
        "start_s": _number(estimate.origin + estimate.start),
        "end_s": _number(estimate.origin + estimate.end),
        "samples": estimate.samples,
        "chi2": _number(estimate.chi2),
        "elapsed_s": estimate.elapsed_s,
    }


def row_of_failure(status: str, message: str) -> Row:
    """Return the columns of a recording, or of a joint, without an estimate."""
    return {"status": status, "message": message, "parameters": [], "free": [], "covariance": []}


def with_provenance(row: Row, found: Found, joint: str, robot: str, warnings: list[str], options: str) -> Row:
    """Return a row with what says where it came from."""
    from joint_id_core.batch.versions import versions

    return {
        "recording": found.place, "robot": robot, "joint": joint, "warnings": warnings, **row,
        "size_bytes": found.size_bytes, "modified": found.modified, "options": options, "versions": versions(),
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
