"""What the online engine does when its assumptions break, and whether it is honest in the long run.

    setup/run python benchmarks/online.py --json out/benchmarks/online.json
    setup/run python benchmarks/online.py --quick

`online.cases` says what happens, `online.joints` to whom, `online.watching` what "said" and "right" mean. Results are
added to those that the JSON file has. With `--docs` the tables of docs/reliability.md are written anew; with `--from`
nothing is measured.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from measured_blocks import write
from online.cases import CASES, MOTIONS
from online.joints import JOINTS
from online.loads import EVERY_S, JOINTS_WITH_LOAD, Loads, loads
from online.long_run import AT_S, LongRun, long_run
from online.pages import changes_table, loads_table, long_table
from online.runs import spread, watched
from online.watching import Outcome
from peers.process import SINGLE_CORE
from speed_peers import machine

JOINTS_BY_MODEL = 4  # of every other model than Model 2, in the long run


def changing(args: argparse.Namespace) -> Iterator[Outcome]:
    """All cases of all models."""
    cases = [c for c in CASES if not args.cases or any(text in c.name for text in args.cases)]
    tasks = [
        (m, motion, seed, cases) for seed in _seeds(args, args.seeds) for m in args.models for motion in args.motions
    ]
    for outcomes in spread(watched, tasks, args.workers):
        for o in outcomes:
            print(
                f"{o.model:18}{o.motion:10}{o.seed:2d} {o.case:26} said {o.said:6.1f}  right {o.right:6.1f}  "
                f"wrong {o.wrong_s:5.1f}  largest {o.largest:7.1f} {o.worst:7} {o.raised}", flush=True,
            )  # fmt: skip
            yield o


def steady(args: argparse.Namespace) -> Iterator[LongRun]:
    """Hours without a change: a fourth of Model 2 in ordinary motion, the other models excited."""
    first, *others = args.models
    count = max(1, round(3600.0 * args.hours / AT_S[-1]))
    tasks = [(first, MOTIONS[k % 4 == 3], k, AT_S[-1]) for k in _seeds(args, count)]
    tasks += [(m, "excited", k, AT_S[-1]) for m in others for k in _seeds(args, min(JOINTS_BY_MODEL, count))]
    for run in spread(long_run, tasks, args.workers):
        print(
            f"{run.model:18}{run.motion:10}{run.seed:3d} {run.seconds:.0f} s  alarms {run.alarms}  "
            f"not converged {run.not_converged:.3f}  largest {run.largest:.1f} {run.worst}", flush=True,
        )  # fmt: skip
        yield run


def coming_and_going(args: argparse.Namespace) -> Iterator[Loads]:
    """Loads that come and go, of the models that have one."""
    models = [m for m in args.models if m in JOINTS_WITH_LOAD]
    every = EVERY_S[:1] if args.quick else EVERY_S
    tasks = [(m, "ordinary", k, at) for k in _seeds(args, args.seeds) for m in models for at in every]
    for found in spread(loads, tasks, args.workers):
        print(f"{found.model:18}{found.seed:3d} every {found.every_s:g} s  right {found.right:.2f}  "
              f"wrong {found.wrong:.2f}  longest {found.longest_s:.1f} s", flush=True)  # fmt: skip
        yield found


def _seeds(args: argparse.Namespace, count: int) -> range:
    return range(args.first, args.first + count)


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    """What a row is of: measured again, it replaces the row of an earlier run."""
    return tuple(row.get(name) for name in ("model", "motion", "seed", "case", "every_s"))


SECTIONS = {"changes": changing, "loads": coming_and_going, "steady": steady}


def main() -> None:
    """Measure, print, write a file, and the tables of the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sections", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--models", nargs="+", choices=tuple(JOINTS), default=list(JOINTS))
    parser.add_argument("--motions", nargs="+", choices=MOTIONS, default=list(MOTIONS))
    parser.add_argument("--cases", nargs="+", help="only those with one of these texts in their names")
    parser.add_argument("--seeds", type=int, default=3, help="joints of each case (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first joint (default: %(default)s)")
    parser.add_argument("--hours", type=float, default=10.0, help="of Model 2 without change (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument(
        "--quick", action="store_true", help="three cases of one joint, and ten minutes without a change"
    )
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/online.json"), help="(default: %(default)s)")
    parser.add_argument("--from", dest="earlier", action="store_true", help="measure nothing, take the JSON file")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/reliability.md")
    args = parser.parse_args()
    if args.quick:
        args.json = args.json.with_name("online_quick.json")
        args.json.unlink(missing_ok=True)
        args.models, args.motions, args.seeds, args.hours = args.models[:1], args.motions[:1], 1, AT_S[-1] / 3600.0
        args.cases = args.cases or ["nothing", "load + 10 %", "frozen"]
    report: dict[str, Any] = json.loads(args.json.read_text()) if args.json.exists() else {}
    if not args.earlier:
        os.environ.update(SINGLE_CORE)
        for name in args.sections:
            args.json.parent.mkdir(parents=True, exist_ok=True)
            rows = {_key(row): row for row in report.get(name, [])}
            for found in SECTIONS[name](args):
                row = asdict(found)
                rows[_key(row)] = row
                args.json.write_text(json.dumps({**report, name: [*rows.values()], "machine": machine()}, indent=1))
            report = json.loads(args.json.read_text())
    tables = {}
    if "changes" in report:
        tables["changes"] = changes_table([Outcome(**row) for row in report["changes"]])
    if "loads" in report:
        tables["loads"] = loads_table([Loads(**row) for row in report["loads"]])
    if "steady" in report:
        runs = [{**row, "off": {float(at): z for at, z in row["off"].items()}} for row in report["steady"]]
        tables["steady"] = long_table([LongRun(**row) for row in runs])
    print("\n\n".join(tables.values()))
    if args.docs:
        write("reliability.md", tables)


if __name__ == "__main__":
    main()
