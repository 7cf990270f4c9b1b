"""How often fits converge, how large their errors are beside the sigma they predict, and how often intervals hold.

    setup/run python benchmarks/stats.py --json out/benchmarks/stats.json

Every case is fitted to many draws of its noise, from starts that are off by up to a factor. The predicted sigma is the
one a fit reports, from its information at the estimate; at the truth that is the Cramer-Rao bound, to first order the
same. So an rms error over sigma of 1 is the physical limit. With n draws that ratio is known to 0.7 / sqrt(n), and a
coverage of 0.95 to 0.22 / sqrt(n). `montecarlo.cases` has the cases, first those whose noise the estimator assumes,
then others. A table has the estimates of a sliding window, the last one the two methods of the paper on the same data.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from montecarlo import online
from montecarlo.cases import CASES, FACTOR
from montecarlo.draws import Draw, many, measure
from montecarlo.methods import METHODS, NEAR
from montecarlo.tables import block, methods_table, summary, table
from peers.process import SINGLE_CORE
from speed_peers import machine

SECTIONS = ("cases", "online", "methods")


def cases(seeds: Sequence[int], cache: Path, workers: int) -> dict[str, list[Draw]]:
    """All cases, each printed as soon as it is there, then their table."""
    found = {}
    for case in CASES:
        found[case.name] = measure(case, seeds, cache, workers)
        print(block(case.name, summary(found[case.name])), flush=True)
    others = sum(not case.as_assumed for case in CASES)
    print(f"starts off by up to {FACTOR:g}; the last {others} rows are not what the estimator assumes")
    print(table({name: summary(draws) for name, draws in found.items()}), flush=True)
    return found


def sliding(seeds: Sequence[int], cache: Path, workers: int) -> dict[str, list[Draw]]:
    """Estimates of a sliding window with memory, from a fifth as many motions."""
    found = online.measure(seeds[: max(1, len(seeds) // 5)], cache, workers)
    for name, draws in found.items():
        print(block(name, summary(draws)), flush=True)
    print("Model 2, a window of 2 s slides over 8 s, memory of 60 s")
    print(table({name: summary(draws) for name, draws in found.items()}), flush=True)
    return found


def methods(seeds: Sequence[int], cache: Path, workers: int) -> dict[str, list[Draw]]:
    """The paper's methods and ours, on Model 2 with all states measured, slow ones on fewer draws."""
    found = {}
    for case in CASES[:2]:
        noise = case.name.rpartition(", ")[2]
        for name, (method, most) in METHODS.items():
            function = partial(method, case, NEAR, cache)
            row = f"{name}, {noise}"
            found[row] = many(function, seeds[:most], workers)
            print(block(row, summary(found[row])), flush=True)
    print(f"Model 2, all four states, starts off by up to {NEAR:g}")
    print(methods_table(found), flush=True)
    return found


def main() -> None:
    """Measure, print, and write all draws to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    cache = Path(tempfile.gettempdir()) / "joint_id_motions"
    parser.add_argument("--draws", type=int, default=200, help="of each case (default: %(default)s)")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--seed", type=int, default=1000, help="of the first draw (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--cache", type=Path, default=cache, help="folder of simulated motions (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="file for all draws")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    seeds = range(args.seed, args.seed + args.draws)
    sections = {"cases": cases, "online": sliding, "methods": methods}
    found = {name: sections[name](seeds, args.cache, args.workers) for name in args.sections}
    if args.json:
        rows = {s: {name: [asdict(d) for d in draws] for name, draws in part.items()} for s, part in found.items()}
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps({"machine": machine(), "seed": args.seed, "draws": args.draws, **rows}))


if __name__ == "__main__":
    main()
