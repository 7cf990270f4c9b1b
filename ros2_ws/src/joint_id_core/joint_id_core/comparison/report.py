"""A comparison as a table for people and as a dictionary for programs."""

from __future__ import annotations

import math
from typing import Any

from joint_id_core.comparison.comparing import Comparison
from joint_id_core.comparison.ranking import Row
from joint_id_core.data.recording import Recording


def as_dict(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison as plain JSON types; missing numbers are NaN, which the JSON writer turns into null."""
    ranking = comparison.ranking
    rows = []
    for r in ranking.rows:
        t = r.trial
        held_out = [
            {"signal": name, "nrmse": v} | ({"r_squared": 1.0 - v**2} if name == t.drive else {})
            for name, v in t.nrmse.items()
        ]
        rows.append(
            {
                "rank": r.rank,
                "candidate": t.label,
                "status": t.estimate.status.value,
                "reason": r.reason,
                "free_parameters": t.free,
                "labels": list(t.labels),
                "observations": t.estimate.observations,
                "bic": t.bic,
                "aic": t.aic,
                "delta_bic": r.delta_bic,
                "held_out": held_out,
                "held_out_score": r.score,
                "estimate": t.estimate.to_dict(),
            }
        )
    return {
        "fitted": _span(comparison.fitted),
        "predicted": _span(comparison.validated),
        "decided_by": list(ranking.signals),
        "best": ranking.best.label if ranking.best else None,
        "conclusion": ranking.conclusion,
        "notes": list(ranking.notes),
        "candidates": rows,
    }


def table(comparison: Comparison) -> str:
    """Return the comparison as lines of text: one row per candidate, best first, the reasons, the result."""
    ranking = comparison.ranking
    names = list(dict.fromkeys(n for r in ranking.rows for n in r.trial.errors))
    drives = {r.trial.drive for r in ranking.rows}
    heads = [f"{n} R^2" if n in drives else n for n in names]
    width = max(len(r.trial.label) for r in ranking.rows)
    widths = [max(len(h), 8) for h in heads]
    lines = [
        f"fitted: {_described(comparison.fitted)}",
        f"predicted: {_described(comparison.validated)}",
        "",
        "  ".join(["   ", f"{'model':<{width}}", f"{'status':<14}", "free", f"{'dBIC':>9}",
                   *(f"{h:>{w}}" for h, w in zip(heads, widths, strict=True))]),
    ]  # fmt: skip
    for r in ranking.rows:
        cells = [f"{_cell(r, n):>{w}}" for n, w in zip(names, widths, strict=True)]
        bic = f"{r.delta_bic:>9.1f}" if math.isfinite(r.delta_bic) else f"{'-':>9}"
        place = f"{r.rank or '-':>3}"
        lines.append(
            "  ".join([place, f"{r.trial.label:<{width}}", f"{r.trial.estimate.status.value:<14}",
                       f"{r.trial.free or '-':>4}", bic, *cells])
        )  # fmt: skip
    lines.append("")
    lines += [f"{r.rank or '-':>3}  {r.trial.label}: {r.reason}" for r in ranking.rows]
    lines.append("")
    if ranking.signals:
        lines.append(f"ranked by what they predict of {', '.join(ranking.signals)}; columns: nrmse, R^2 of a drive")
    lines += [f"note: {note}" for note in ranking.notes]
    return "\n".join([*lines, ranking.conclusion])


def _cell(row: Row, name: str) -> str:
    value = row.trial.nrmse.get(name)
    if value is None:
        return "-"
    return f"{1.0 - value**2:.5f}" if name == row.trial.drive else f"{value:.3g}"


def _span(recording: Recording) -> dict[str, Any]:
    return {
        "source": recording.source,
        "samples": len(recording),
        "start_s": recording.origin + float(recording.time[0]),
        "end_s": recording.origin + float(recording.time[-1]),
    }


def _described(recording: Recording) -> str:
    gaps = f", {recording.gaps} gaps" if recording.gaps else ""
    start, end = (recording.origin + float(t) for t in (recording.time[0], recording.time[-1]))
    return f"{recording.source}, {start:.6g} to {end:.6g} s, {len(recording)} samples{gaps}"
