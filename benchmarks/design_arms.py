"""Whether fits of simulated arms keep what the design of their motion promised, and what other motions promise.

    setup/run python benchmarks/design_arms.py --descriptions 12 --arms 10

`designed_arms.arms` says what is simulated: arms of three sizes whose dynamics are those of MuJoCo, and which differ
from their description by 20 % in every mass, friction and noise. With `--docs` the tables of docs/benchmarks.md are
written anew; with `--from` nothing is measured.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path

from peers.process import SINGLE_CORE

os.environ.update(SINGLE_CORE)  # times are processor times: libraries read this when they are imported

from designed_arms.runs import Foreseen, Found, run
from designed_arms.tables import table
from measured_blocks import write


def main() -> None:
    """Measure, print, write a file, and the tables of the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--descriptions", type=int, default=12, help="how many (default: %(default)s)")
    parser.add_argument("--arms", type=int, default=10, help="true arms of each (default: %(default)s)")
    file = Path("out/benchmarks/design_arms.json")
    parser.add_argument("--json", type=Path, default=file, help="(default: %(default)s)")
    parser.add_argument("--from", dest="earlier", action="store_true", help="measure nothing, take the JSON file")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/benchmarks.md")
    args = parser.parse_args()
    if not args.earlier:
        report: dict[str, list[dict[str, object]]] = {"motions": [], "arms": []}
        args.json.parent.mkdir(parents=True, exist_ok=True)
        for number, (rows, found) in enumerate(run(range(args.descriptions), args.arms)):
            report["motions"] += [asdict(row) for row in rows]
            report["arms"] += [asdict(one) for one in found]
            args.json.write_text(json.dumps(report))
            print(f"description {number + 1} of {args.descriptions}", flush=True)
    report = json.loads(args.json.read_text())
    told = table([Foreseen(**row) for row in report["motions"]], [Found(**row) for row in report["arms"]])  # type: ignore[arg-type]  # JSON
    print(told)
    if args.docs:
        write("benchmarks.md", {"design-arm": told})


if __name__ == "__main__":
    main()
