"""`docs/paper.md`: the template `page.md` filled with tables and figures of the study."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from joint_id_core.results.estimate import Estimate
from reproduction import published
from reproduction.cases import FACTOR, NEAR, SMOOTHING
from reproduction.study import Row, Size

TEMPLATE = Path(__file__).with_name("page.md")
UNKNOWN = 0.5  # relative standard deviation from which a record does not show a parameter


@dataclass(frozen=True)
class Results:
    """Everything that the study found; `shown` by model (see `study.shown`), `log` both fits of the UR3e log."""

    size: Size
    table_2: Sequence[Row]
    table_4: Sequence[Row]
    table_5: Sequence[Row]
    stiff: Sequence[Row]
    shown: Mapping[str, Mapping[str, float]]
    epochs: Mapping[str, float]
    log: Sequence[Estimate]


def page(results: Results) -> str:
    """The whole page."""
    size = results.size
    one, three = (
        [r for r in rows if (r.labels, r.samples) == key]
        for rows, key in ((results.table_2, ("2", 700)), (results.table_4, ("5 + torsion", 500)))
    )
    ours_1, ours_3, hpinn = (
        next(r for r in rows if r.method == method)
        for rows, method in ((one, "innovations"), (three, "innovations"), (three, "H-PINN"))
    )
    worst = max((n for n in published.TABLE_3 if n not in ("c_b", "c_m")), key=ours_3.error)
    names = list(ours_3.case.model.state_names)
    states, ratio = ours_3.case.states, ours_3.case.truth["N"]
    twist = states[:, names.index("motor_position")] / ratio - states[:, names.index("link_position")]
    return TEMPLATE.read_text().format(
        factor=f"{FACTOR:g}", near=f"{NEAR:g}",
        starts=size.starts, slow_starts=size.slow_starts, limit=f"{size.limit_s:g}",
        machine=f"{platform.machine()}, Python {platform.python_version()}", smoothing=f"{SMOOTHING:g}",
        unknown=f"{100 * UNKNOWN:g} %",
        table_1=_parameters(one, published.TABLE_1, results.shown["dc_motor"]),
        table_2=_conditions(results.table_2, published.TABLE_2),
        status=" or ".join(sorted({f"`{run.ended}`" for row in (ours_1, ours_3) for run in row.runs})),
        worst_1=_percent(max(ours_1.error(n) for n in published.TABLE_1)),
        table_3=_parameters(three, published.TABLE_3, results.shown["electromechanical"]),
        table_4=_conditions(results.table_4, published.TABLE_4),
        sum_error=_percent(max(_sum_errors(ours_3))), worst_name=worst, worst_3=_percent(ours_3.error(worst)),
        twist=f"{1e3 * float(twist.max()):.2g}", hpinn_time=f"{hpinn.time_s:.2g} s", speed=_speed(results.epochs),
        stiff=_stiff(results.stiff), table_5=_table_5(results.table_5), log=_log(results.log),
    )  # fmt: skip


def _percent(value: float) -> str:
    if not isfinite(value):
        return "-"
    return f"{100 * value:.2g} %" if value < 10.0 else "> 1000 %"


def _number(value: float) -> str:
    return f"{value:.3g}" if isfinite(value) else "-"


def _lines(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def _parameters(
    rows: Sequence[Row], printed: Mapping[str, tuple[float, Mapping[str, float]]], shown: Mapping[str, float]
) -> str:
    methods = list(dict.fromkeys(m for _, by_method in printed.values() for m in by_method))
    head = ["", "truth", "shown", *(r.method for r in rows), *(f"{m}, paper" for m in methods)]
    lines = []
    for name, (truth, by_method) in printed.items():
        errors = [*(r.error(name) for r in rows), *(abs(by_method[m] / truth - 1.0) for m in methods)]
        best = min(e for e in errors if isfinite(e))
        cells = [f"**{_percent(e)}**" if e == best else _percent(e) for e in errors]
        limit = _percent(shown[name]) + (" (not known)" if shown[name] > UNKNOWN else "")
        lines.append([f"`{name}`", f"{truth:.4g}", limit, *cells])
    return _lines(head, lines)


def _conditions(rows: Sequence[Row], printed: Sequence[published.Row]) -> str:
    head = ["method", "epochs", "labels", "samples", "time", "MSE", "time, paper", "MSE, paper"]
    lines = []
    for r in rows:
        paper = next((p for p in printed if (p.method, p.labels, p.samples) == (r.method, r.labels, r.samples)), None)
        ours = [f"{_number(r.time_s)} s", _number(r.mse)] if r.runs else [r.note, "-"]
        ended = r.best().ended if r.runs else ""
        name = f"{r.method} ({ended})" if ended.startswith("no end") else r.method
        theirs = [f"{paper.time_s:g} s", f"{paper.mse:g}"] if paper else ["", ""]
        lines.append([name, str(r.epochs or ""), r.labels, str(r.samples), *ours, *theirs])
    return _lines(head, lines)


def _sum_errors(row: Row) -> list[float]:
    truth = row.case.truth["c_b"] + row.case.truth["c_m"]
    return [abs((r.values["c_b"] + r.values["c_m"]) / truth - 1.0) for r in row.runs]


def _speed(epochs: Mapping[str, float]) -> str:
    if not epochs:
        return ""
    eager, compiled = epochs["eager"], epochs["compiled"]
    return (
        f" In the same run an epoch takes {eager:.2g} s in eager torch and {1e3 * compiled:.2g} ms through the "
        f"compiled cell, which is {eager / compiled:.0f} times faster."
    )


def _stiff(rows: Sequence[Row]) -> str:
    names = ("R", "k_b", "k_t", "c_m", "c_1", "k_1", "c_q")
    lines = []
    for r in rows:
        errors = (_percent(r.error(n)) for n in names)
        lines.append([r.method, r.best().ended.replace("_", " "), f"{_number(r.time_s)} s", *errors])
    return _lines(["", "status", "time", *(f"`{n}`" for n in names)], lines)


def _table_5(rows: Sequence[Row]) -> str:
    lines = []
    for name, by_method in published.TABLE_5.items():
        theirs = [f"{by_method[m]:.4g}" for m in ("H-PINN", "NLGR")]
        ours = (_percent(r.error(name)) for r in rows)
        lines.append([f"`{name}`", f"{rows[0].case.truth[name]:.4g}", *ours, *theirs])
    paper = [f"{published.TABLE_5_TIME[m]:g} s" for m in ("H-PINN", "NLGR")]
    lines.append(["time", "", *(f"{_number(r.time_s)} s" for r in rows), *paper])
    return _lines(["", "truth", *(r.method for r in rows), "H-PINN, paper", "NLGR, paper"], lines)


def _log(found: Sequence[Estimate]) -> str:
    if not found:
        return "The public UR3e log was not present when this page was made."
    lines = []
    for estimate in found:
        rows = [estimate[n] for n in estimate.free if n in ("J_m", "k_1", "J_q", "tau_fm")]
        values = ", ".join(f"`{r.name}` {r.value:.3g} ± {r.std_dev:.2g}" for r in rows)
        lines.append([f"`{estimate.model}`", estimate.status.value.replace("_", " "), values])
    return (
        "On the shoulder of the public UR3e log ([UR robots](tutorials/ur_robots.md): link position, motor velocity "
        "and current at 125 Hz) it finds:\n\n"
        + _lines(["model", "status", "estimates"], lines)
        + "\n\nModel 2 as a whole does not describe this log, and the fit says so. Its motor side alone does."
    )
