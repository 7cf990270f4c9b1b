"""Other online methods beside ours: Model 2 with the signals of a UR robot, one record at a time through all of them.

    setup/run python benchmarks/online_peers.py --json out/benchmarks/online_peers.json

Recursive least squares on Butterworth-differentiated signals, an extended Kalman filter with the parameters as
states, a moving-horizon estimator with CasADi, and the online identifier. All begin at the nominal values, from which
the joints are up to 15 % off, and forget with a time constant of 60 s. Kalman filter and moving horizon are told the
true noise levels. Samples come ten at a time; times are processor time of one thread. The acados library is not among
them: it has no package for pip.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
from measured_blocks import write
from online.joints import joint
from online.records import steady
from online_methods.common import Method, signals
from peers.process import SINGLE_CORE
from speed_peers import machine

BATCH = 10  # samples of an update
INTERVAL = 1.959964  # standard deviations: 95 %
METHODS = {
    "joint_id": ("ours", "Online"),
    "recursive least squares": ("rls", "RecursiveLeastSquares"),
    "extended Kalman filter": ("ekf", "ExtendedKalmanFilter"),
    "moving horizon (CasADi)": ("mhe", "MovingHorizonEstimator"),
}


@dataclass(frozen=True)
class Run:
    """A method on one record.

    Attributes:
        method, seed: which.
        errors, sigmas: relative to the truth at the end of the record, by parameter.
        us: processor time of a sample in us; slowest_ms: that which 999 of 1000 updates do not exceed, in ms.
        failed: what went wrong; empty otherwise.
    """

    method: str
    seed: int
    errors: Mapping[str, float]
    sigmas: Mapping[str, float]
    us: float
    slowest_ms: float
    failed: str = ""


def run(name: str, seed: int, channels: Mapping[str, np.ndarray], truth: Mapping[str, float]) -> Run:
    """Feed a record to a method; a library that is not installed, or numbers that are not finite, are told."""
    module, kind = METHODS[name]
    try:
        make: Callable[[], Method] = getattr(import_module(f"online_methods.{module}"), kind)
    except ImportError as error:
        return Run(name, seed, {}, {}, np.nan, np.nan, f"not installed: {error.name or error}")
    samples = signals(channels)
    warm = make()  # compilation is not counted
    for k in range(0, 2000, BATCH):
        warm.update(samples.part(k, k + BATCH))
    method, took = make(), []
    with np.errstate(all="ignore"):
        try:
            for k in range(0, len(samples.q), BATCH):
                begun = time.thread_time()
                method.update(samples.part(k, k + BATCH))
                took.append(time.thread_time() - begun)
            known = method.known()
        except np.linalg.LinAlgError as error:
            return Run(name, seed, {}, {}, np.nan, np.nan, f"diverged: {error}")
    errors = {n: value / truth[n] - 1.0 for n, value in known.values.items()}
    sigmas = {n: value / truth[n] for n, value in known.sigmas.items()}
    failed = "" if np.isfinite([*errors.values(), *sigmas.values()]).all() else "not finite"
    us = 1e6 * sum(took) / len(samples.q)
    return Run(name, seed, errors, sigmas, us, 1e3 * float(np.quantile(took, 0.999)), failed)


def table(runs: Sequence[Run]) -> str:
    """A row for each method."""
    lines = [
        "| method | joints | error, median | worst of nine | error / sigma | coverage | a sample | p99.9 of updates |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]  # fmt: skip
    for name in dict.fromkeys(r.method for r in runs):
        every = [r for r in runs if r.method == name]
        some = [r for r in every if not r.failed]
        if not some:
            lines.append(f"| {name} | 0 of {len(every)}: {every[0].failed} | - | - | - | - | - | - |")
            continue
        e = np.array([list(r.errors.values()) for r in some])
        z = e / np.array([list(r.sigmas.values()) for r in some])
        lines.append(
            f"| {name} | {len(some)} of {len(every)} | {100 * np.median(np.abs(e)):.2g} % | "
            f"{100 * np.median(np.abs(e).max(axis=1)):.2g} % | {np.sqrt(np.mean(z**2)):.2g} | "
            f"{np.mean(np.abs(z) < INTERVAL):.2f} | {np.median([r.us for r in some]):.3g} us | "
            f"{np.median([r.slowest_ms for r in some]):.2g} ms |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--methods", nargs="+", choices=tuple(METHODS), default=list(METHODS), metavar="METHOD")
    parser.add_argument("--seeds", type=int, default=8, help="joints (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of a record (default: %(default)s)")
    default = Path("out/benchmarks/online_peers.json")
    parser.add_argument("--json", type=Path, default=default, help="(default: %(default)s)")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmarks.md")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    runs = []
    for seed in range(args.seeds):
        watched = steady(joint("harmonic_drive"), "excited", seed, args.seconds)
        for name in args.methods:
            runs.append(run(name, seed, watched.recording.channels, watched.truth(0.0)))
            worst = max(map(abs, runs[-1].errors.values()), default=np.nan)
            print(f"{seed} {name}: {runs[-1].us:.0f} us, worst {100 * worst:.2g} % {runs[-1].failed}", flush=True)
    print(table(runs))
    args.json.parent.mkdir(parents=True, exist_ok=True)
    report = {"machine": machine(), "seconds": args.seconds, "runs": [asdict(r) for r in runs]}
    args.json.write_text(json.dumps(report, indent=1))
    if args.docs:
        write("benchmarks.md", {"peers": table(runs)})


if __name__ == "__main__":
    main()
