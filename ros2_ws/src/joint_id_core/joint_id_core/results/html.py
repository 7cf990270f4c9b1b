"""An estimate as an HTML table, for notebooks."""

from __future__ import annotations

import math
from html import escape

from joint_id_core.results.estimate import Estimate, ParameterEstimate


def table(estimate: Estimate) -> str:
    """Return status, message and a table with one row per parameter as HTML without styles."""
    head = "".join(f"<th>{name}</th>" for name in ("parameter", "value", "std dev", "unit", "verdict", "reason"))
    rows = "".join(_row(p) for p in estimate.parameters)
    title = f"{escape(estimate.model)} by {escape(estimate.estimator)}: <b>{escape(estimate.status.value)}</b>"
    return (
        f"<div><p>{title}<br>{escape(estimate.message)}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _row(p: ParameterEstimate) -> str:
    deviation = f"{p.std_dev:.2g}" if math.isfinite(p.std_dev) else ""
    cells = (p.name, f"{p.value:.6g}", deviation, p.unit, p.verdict.value, p.reason)
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
