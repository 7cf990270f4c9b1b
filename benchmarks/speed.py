"""Speed of the engine, as ratios to a rollout in C++ written by hand (`kernel.cpp`) that takes turns with it.

    setup/run python benchmarks/speed.py --json out/benchmarks/speed.json

The unit of all ratios is one C++ rollout with the sensitivities of all parameters, of the same window at the same
number of RK4 steps. Everything runs on one core with libraries that keep to one thread; processor time stands beside
wall time, which on a shared machine is longer. `engine` has a file for each table.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from engine import fits, kernel, scaling, start_up, windows
from engine.timing import alone
from peers.process import SINGLE_CORE
from speed_peers import machine

# By name: what measures, and what makes a table of it. Those that time calls in one process run alone on one core.
SECTIONS: dict[str, tuple[Callable[[Path, int], Any], Callable[[Any], str], bool]] = {
    "kernel": (kernel.measure, kernel.table, True),
    "fits": (fits.measure, fits.table, True),
    "shares": (fits.shares, fits.shares_table, True),
    "windows": (windows.measure, windows.table, True),
    "scaling": (scaling.measure, scaling.table, False),
    "start_up": (start_up.measure, start_up.table, True),
}


def measure(sections: Sequence[str], cache: Path, rounds: int) -> dict[str, Any]:
    """Measure, print each table as soon as it is there, and return all of it as plain data."""
    found = {}
    for name in sections:
        function, table, on_one_core = SECTIONS[name]
        result = alone(function, cache, rounds) if on_one_core else function(cache, rounds)
        print(table(result), flush=True)
        found[name] = _plain(result)
    return found


def _plain(result: Any) -> Any:
    if is_dataclass(result) and not isinstance(result, type):
        return asdict(result)
    return [_plain(item) for item in result] if isinstance(result, list) else result


def main() -> None:
    """Measure, print, and write a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    cache = Path(tempfile.gettempdir()) / "joint_id_motions"
    parser.add_argument("--sections", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--rounds", type=int, default=15, help="in which calls take turns (default: %(default)s)")
    parser.add_argument("--cache", type=Path, default=cache, help="folder of simulated motions (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="file for all times")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    load = os.getloadavg()[0]
    print(f"load of the machine before: {load:.1f} on {os.cpu_count()} cores\n", flush=True)
    report = {"machine": machine(), "load": load, **measure(args.sections, args.cache, args.rounds)}
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
