"""The fits of several joints as a table, or as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from joint_id_core.jobs.fit_job import Result


def joints_table(results: Mapping[str, Result | str]) -> str:
    """Return a table with a row a joint: status, and the estimated parameters."""
    from joint_id_core.results.report import estimated

    width = max(len("joint"), *map(len, results)) + 2
    lines = [f"  {'joint':<{width}}{'model':<22}{'status':<16}parameters"]
    also: dict[str, list[str]] = {}  # joints by message: what is wrong with all of them is said once
    for joint, result in results.items():
        if isinstance(result, str):
            lines.append(f"  {joint:<{width}}{'-':<22}{'not fitted':<16}")
            also.setdefault(result, []).append(joint)
            continue
        estimate = result.estimate
        gravity = " gravity" if estimate.model_options.get("gravity") else ""
        lines.append(
            f"  {joint:<{width}}{estimate.model + gravity:<22}{estimate.status.value:<16}{estimated(estimate) or '-'}"
        )
        if not estimate.converged:
            also.setdefault(estimate.message, []).append(joint)
    remarks = [f"  {', '.join(joints)}: {text}" for text, joints in also.items()]
    return "\n".join([*lines, *([""] if also else []), *remarks])


def joints_json(results: Mapping[str, Result | str]) -> list[dict[str, Any]]:
    """Return the results as plain JSON types, an entry a joint."""
    return [
        {"joint": joint, "error": result} if isinstance(result, str) else {"joint": joint, **result.estimate.to_dict()}
        for joint, result in results.items()
    ]
