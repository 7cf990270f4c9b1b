"""How honest and how near fits of public recordings of real robots are, beside plain least squares.

    setup/run python benchmarks/robots.py --json out/benchmarks/robots.json

The recordings are no part of the project: they are expected beside it in ../shared/data, and rows without data are
skipped. `robots.cases` and `robots.whole_arm` say what is fitted, `robots.judging` what the figures mean. With
`--docs` the tables of docs/real_robots.md are written anew; with `--from` nothing is measured.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from peers.process import SINGLE_CORE

os.environ.update(SINGLE_CORE)  # times are processor times: libraries read this when they are imported

from measured_blocks import write
from robots import followed_arm, live, stiffness, whole_arm, wrong_model
from robots.arm_peers import found as of_arm
from robots.arm_peers.pages import peers_table
from robots.arm_peers.runs import methods
from robots.cases import CASES
from robots.fitted import Fitted, Value, of_json
from robots.methods import fits
from robots.pages import joints_table, methods_table, stiffness_table, table, targets_table
from speed_peers import machine


def rigid(names: list[str] | None) -> list[Fitted]:
    """All fits of rigid joints whose data are there, each printed; `names`: only cases with one of these texts."""
    found = []
    for case in CASES:
        if names and not any(text in case.name for text in names):
            continue
        if not case.there:
            print(f"{case.name}: skipped, there is no ../shared/data/{case.folder}")
            continue
        for f in fits(case):
            shown = "  ".join(f"{n} {v.value:.3g} +- {v.sigma:.2g} {v.verdict}" for n, v in f.values.items())
            print(f"{f.recording}, {f.joint}, {f.method}: {f.status}  {shown}", flush=True)
            found.append(f)
    return found


def main() -> None:
    """Measure, print, write a file, and the tables of the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", nargs="+", help="only those with one of these texts in their names (e.g. KUKA)")
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/robots.json"), help="(default: %(default)s)")
    parser.add_argument("--from", dest="earlier", action="store_true", help="measure nothing, take the JSON file")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/real_robots.md")
    args = parser.parse_args()
    complete = stiffness.there() and all(case.there for case in CASES)
    if args.docs and (args.cases or not (args.earlier or complete)):
        parser.error("--docs writes whole tables: leave out --cases, and put all recordings into ../shared/data")
    if not args.earlier:
        axes = not args.cases or any(text in "KUKA" for text in args.cases)
        if axes and not stiffness.there():
            print(f"KUKA: skipped, there is no ../shared/data/{stiffness.FOLDER}")
        report: dict[str, Any] = {
            "machine": machine(),
            "fits": [asdict(f) for f in rigid(args.cases)],
            "stiffness": [asdict(f) for f in stiffness.fits()] if axes and stiffness.there() else [],
            "wrong_model": [asdict(r) for r in wrong_model.rows()] if not args.cases else [],
            "live": [asdict(r) for r in live.followed(args.cases)],
            "payload": whole_arm.payload() if not args.cases and whole_arm.there() else [],
            "whole_arm": [asdict(r) for r in whole_arm.rows()] if not args.cases and whole_arm.there() else [],
            "followed_arm": [asdict(r) for r in followed_arm.runs()] if not args.cases and whole_arm.there() else [],
            "arm_peers": [asdict(m) for m in methods()] if not args.cases and whole_arm.there() else [],
        }
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(report, indent=1))
    report = json.loads(args.json.read_text())
    found = [of_json(row) for row in report["fits"]]
    axes_found = [
        stiffness.Stiffness(**{**row, "values": {n: Value(**v) for n, v in row["values"].items()}})
        for row in report["stiffness"]
    ]
    arm = [whole_arm.Row(**row) for row in report.get("whole_arm", [])]
    wrong = [wrong_model.Row(**row) for row in report.get("wrong_model", [])]
    tables = {
        "robots-targets": targets_table(found, axes_found), "robots": methods_table(found),
        "robots-joints": joints_table(found), "robots-stiffness": stiffness_table(axes_found),
        "robots-wrong-model": table(wrong_model.HEAD, map(wrong_model.cells, wrong)),
        "robots-live": live.live_table([live.Live(**row) for row in report.get("live", [])]),
        "robots-payload": whole_arm.payload_table(report.get("payload", [])),
        "robots-arm": whole_arm.table(arm), "robots-links": whole_arm.links_table(arm),
        "robots-arm-followed": followed_arm.table([followed_arm.Run(**r) for r in report.get("followed_arm", [])]),
        "robots-arm-peers": peers_table([of_arm.of_json(row) for row in report.get("arm_peers", [])]),
    }  # fmt: skip
    print("\n\n".join(tables.values()))
    if args.docs:
        write("real_robots.md", tables)


if __name__ == "__main__":
    main()
