"""How rarely the drift monitor reports a parameter that has not drifted, and how soon one that has.

    setup/run python benchmarks/drift.py --write docs/reliability.md

First the control chart alone, on estimates drawn from their exact distribution: thousands of hours. Then the monitor
behind the online identifier, on simulated signals of a joint: minutes of motion for each of many joints.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from peers.process import SINGLE_CORE
from run_length import chart, joint

from joint_id_core.online.drift import DriftOptions

DEFAULT = DriftOptions()
THRESHOLDS = (3.0, 4.0, 5.0, 6.0)
CONFIRM_S = (0.0, DEFAULT.drift_confirm_s)
LOW = (2.0, 2.5, 3.0)  # thresholds that minutes of motion can tell something about
TOLERANCES = (0.02, 0.05)
CHANGES = (0.05, 0.10, 0.20)
SIGMAS = (0.003, 0.01)  # relative standard deviation of an estimate
WIDTHS = (0.0, 1.0, 2.0)  # tolerances in standard deviations of an estimate
RUN_HOURS = 20.0  # of each simulated joint with the chart alone
SLOW_S = 600.0  # duration of a slow drift
BLOCK = re.compile(r"(<!-- made by: make bench-drift -->\n).*?(<!-- end of bench-drift -->)", re.DOTALL)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows))


def seconds(times: Sequence[float], longest_s: float) -> str:
    """Mean of delays; how many were missed, if any."""
    found = [t for t in times if math.isfinite(t)]
    if not found:
        return f"none in {longest_s:.0f} s"
    text = f"{np.mean(found):.2g}" if np.mean(found) < 99.5 else f"{np.mean(found):.0f}"
    return f"{text} s" + (f" ({len(found)} of {len(times)})" if len(found) < len(times) else "")


def false_alarms(hours: float) -> str:
    """Hours of motion between two false alarms by threshold: the chart alone."""
    joints = max(1, round(hours / RUN_HOURS))
    far = 30.0  # any tolerance that is wide against the noise gives the same at its edge
    cases = [(far, far), *((width, 0.0) for width in WIDTHS)]
    rows = []
    for confirm_s in CONFIRM_S:
        columns = [
            chart.false_alarms(np.array(THRESHOLDS), width, shift, joints, RUN_HOURS, confirm_s, seed)
            for seed, (width, shift) in enumerate(cases)
        ]
        for k, h in enumerate(THRESHOLDS):
            mark = " (default)" if (h, confirm_s) == (DEFAULT.drift_threshold, DEFAULT.drift_confirm_s) else ""
            rows.append([f"{h:g}{mark}", f"{confirm_s:g} s", *(column[k].text for column in columns)])
    widths = ["no tolerance", *(f"tolerance of {w:g} σ" for w in WIDTHS[1:])]
    return table(
        ["threshold", "confirmed for", "at the edge of the tolerance", *(f"unchanged, {w}" for w in widths)], rows
    )


def chart_delays(joints: int) -> str:
    """Delay after a sudden change that the engine itself does not notice: the chart alone."""
    longest_s, rows = 3600.0, []
    for tolerance in TOLERANCES:
        for sigma in SIGMAS:
            for seed, h in enumerate(THRESHOLDS):
                sizes = (
                    chart.delays(h, tolerance / sigma, c / sigma, joints, longest_s, DEFAULT.drift_confirm_s, seed)
                    for c in CHANGES
                )
                rows.append(
                    [
                        f"{tolerance:g}",
                        f"{100.0 * sigma:g} %",
                        f"{h:g}",
                        *(seconds(s.tolist(), longest_s) for s in sizes),
                    ]
                )
    return table(["tolerance", "σ of an estimate", "threshold", *(f"+{100.0 * c:g} %" for c in CHANGES)], rows)


def watched(runs: int, length_s: float, pool: Any) -> tuple[str, dict[str, Any]]:
    """Joints that do not change, through the engine."""
    options = [(t, confirm_s) for t in (0.0, *TOLERANCES) for confirm_s in CONFIRM_S]
    defaults = tuple((t, DEFAULT.drift_threshold, confirm_s) for t, confirm_s in options)
    charts = (*((0.0, h, 0.0) for h in LOW), *defaults)
    rows, data = [], {}
    for kind in joint.MOTIONS:
        found = pool.map(partial(joint.unchanged_job, length_s, charts), [(kind, s) for s in range(1, runs + 1)], 1)
        hours = sum(w.hours for w in found)
        z = np.concatenate([w.z for w in found])
        known = float(np.mean(np.isfinite(z)) * z.shape[1])
        ratio = np.sqrt(np.nanmean(z**2, axis=0))
        expected = chart.false_alarms(np.array(LOW), 0.0, 0.0, 20000, hours / runs, 0.0, 3)
        alarms = {c: sum(w.alarms[c] for w in found) for c in charts}
        counts = [
            f"{alarms[0.0, h, 0.0]} ({e.count / e.hours * hours * known:.3g} expected)"
            for h, e in zip(LOW, expected, strict=True)
        ]
        rows.append(
            [kind, f"{hours:.2g} h", f"{np.nanmin(ratio):.2f} to {np.nanmax(ratio):.2f}", *counts,
             *(str(alarms[c]) for c in defaults)]
        )  # fmt: skip
        data[kind] = {"hours": hours, "ratio": ratio.tolist(), "alarms": {str(c): n for c, n in alarms.items()}}
    head = ["motion", "watched", "rms error / σ, by parameter", *(f"0, {h:g}, 0 s" for h in LOW)]
    return table([*head, *(f"{t:g}, {h:g}, {c:g} s" for t, h, c in defaults)], rows), data


def engine_delays(runs: int, longest_s: float, pool: Any) -> tuple[str, dict[str, Any]]:
    """Delays through the engine, of sudden and of slow changes."""
    charts = [(t, DEFAULT.drift_threshold, confirm_s) for t in TOLERANCES for confirm_s in CONFIRM_S]
    rows, data = [], {}
    for rise_s in (0.0, SLOW_S):
        changes, count = (CHANGES, runs) if not rise_s else (CHANGES[-1:], max(1, runs // 2))
        for kind in joint.KINDS:
            for change in changes:
                jobs = [(kind, change, rise_s, seed) for seed in range(1, count + 1)]
                found = pool.map(partial(joint.delay_job, charts, longest_s), jobs, 1)
                cells = [seconds([f[c] for f in found], longest_s) for c in charts]
                course = f"within {rise_s / 60.0:g} min" if rise_s else "suddenly"
                what = "all friction" if kind == "friction" else kind
                rows.append([f"{what} +{100.0 * change:g} % {course}", str(len(jobs)), *cells])
                data[f"{kind} {change} {rise_s}"] = [{str(c): t for c, t in f.items()} for f in found]
                print(rows[-1], flush=True)
    return table(["change", "runs", *(f"tolerance {t:g}, {c:g} s" for t, _, c in charts)], rows), data


def main() -> None:
    """Simulate, print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hours", type=float, default=5e4, help="of one parameter, chart alone (default: %(default)g)")
    parser.add_argument("--runs", type=int, default=6, help="of each case, through the engine (default: %(default)s)")
    parser.add_argument("--length", type=float, default=600.0, help="s of a joint that does not change (%(default)g)")
    parser.add_argument("--longest", type=float, default=120.0, help="s waited for a report (default: %(default)g)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="file for the results through the engine")
    parser.add_argument("--write", type=Path, help="page whose block of this benchmark is written anew")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        changed, delay_data = engine_delays(args.runs, args.longest, pool)
        same, same_data = watched(args.runs, args.length, pool)
    made = {
        "Mean hours of motion between two false alarms of one parameter, by threshold, the chart alone, with "
        "standard errors:": false_alarms(args.hours),
        f"Mean delay through `OnlineIdentifier`, threshold {DEFAULT.drift_threshold:g}, from when the truth leaves the "
        "tolerance; columns: tolerance, time of confirmation:": changed,
        "Joints that do not change, through `OnlineIdentifier`: number of reports of all parameters together, beside "
        "that of the chart alone; columns: tolerance, threshold, time of confirmation:": same,
        "Mean delay of the chart alone, after a sudden change that the engine itself does not notice, with the "
        "default confirmation:": chart_delays(max(20, round(args.hours / 100.0))),
    }
    text = "\n\n".join(f"{title}\n\n{rows}" for title, rows in made.items())
    print(text)
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps({"changed": delay_data, "unchanged": same_data}))
    if args.write:
        args.write.write_text(BLOCK.sub(lambda m: f"{m[1]}{text}\n{m[2]}", args.write.read_text()))


if __name__ == "__main__":
    main()
