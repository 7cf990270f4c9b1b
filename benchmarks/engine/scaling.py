"""How a fit of Model 2 grows with its window, in time and in memory, and what a second core brings to six joints."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from simulated import MODEL_2, ClosedLoop, Torque, motion, start

from engine.fits import FACTOR, measured
from engine.timing import Times, alone, in_turn, keep_to_one_core, once
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit

TARGET = 1.1
LENGTHS = (250, 500, 1000, 2000, 4000, 8000, 16000)
SLOPE_FROM = 1000  # samples; below, the fixed part of a fit is in the way
SEEDS = (1000, 1001, 1002)
LONG = ClosedLoop(LENGTHS[-1], Torque(white=0.003))
JOINTS, JOINT_SAMPLES, CORES = 6, 1000, 2


@dataclass(frozen=True)
class LengthTimes:
    """A fit of a window of `samples`: medians over starts, and `memory` in bytes that it needs at its peak."""

    samples: int
    converged: int
    starts: int
    iterations: float
    fit: Times
    memory: int


@dataclass(frozen=True)
class Scaling:
    """Windows of all lengths, and by way of working the wall times in s of a fit of six joints."""

    lengths: Sequence[LengthTimes]
    joints: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def slope(self) -> float:
        """Of the logarithm of time by that of length, from `SLOPE_FROM` samples on."""
        rows = [row for row in self.lengths if row.samples >= SLOPE_FROM]
        x, y = (np.log([f(row) for row in rows]) for f in (lambda r: r.samples, lambda r: r.fit.cpu_s))
        return float(np.polyfit(x, y, 1)[0])


def measure(cache: Path, rounds: int) -> Scaling:
    """Measure on motions from `cache`; memory and joints in processes of their own, which may use all cores."""
    lengths = alone(_lengths, cache, rounds)
    memory = {samples: alone(peak_memory, cache, samples) for samples in LENGTHS}
    rows = [LengthTimes(memory=memory[samples], samples=samples, **row) for samples, row in lengths.items()]
    return Scaling(rows, _joints(cache, rounds))


def _lengths(cache: Path, rounds: int) -> dict[int, dict]:
    recording = measured(motion(LONG, SEEDS[0], cache), SEEDS[0])
    found = {}
    for samples in LENGTHS:
        part, times, estimates = recording.slice(0, samples), [], []
        for seed in SEEDS:
            call = partial(fit, MODEL_2, part, start(MODEL_2, seed, FACTOR))
            estimates.append(call())
            times.append(in_turn({"fit": call}, rounds)["fit"])
        found[samples] = {
            "converged": sum(e.converged for e in estimates),
            "starts": len(SEEDS),
            "iterations": float(np.median([e.iterations for e in estimates])),
            "fit": Times.median(times),
        }
    return found


def peak_memory(cache: Path, samples: int) -> int:
    """Bytes by which a fit of `samples` raises the peak of this process, which has fitted a short window before.

    Linux only: the peak is that of /proc, because `getrusage` tells a child of the peak of its parent.
    """
    recording = measured(motion(LONG, SEEDS[0], cache), SEEDS[0])
    values = start(MODEL_2, SEEDS[0], FACTOR)
    fit(MODEL_2, recording.slice(0, LENGTHS[0]), ParameterSettings(values))
    part = recording.slice(0, samples)
    Path("/proc/self/clear_refs").write_text("5")
    before = _status("VmRSS")
    fit(MODEL_2, part, ParameterSettings(values))
    return max(0, _status("VmHWM") - before)


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))


def fit_joint(recording: Recording, seed: int) -> int:
    """Fit one of several joints; returns little, as a node that publishes an estimate does."""
    return fit(MODEL_2, recording, ParameterSettings(start(MODEL_2, seed, FACTOR))).iterations


def _joints(cache: Path, rounds: int) -> dict[str, list[float]]:
    """Wall time of each round, all ways in turn: one process on one core, threads, processes."""
    short = ClosedLoop(JOINT_SAMPLES, LONG.torque)
    seeds = [SEEDS[0] + k for k in range(JOINTS)]
    recordings = [measured(motion(short, seed, cache), seed) for seed in seeds]
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, context, keep_to_one_core) as one,
        ThreadPoolExecutor(CORES) as threads,
        ProcessPoolExecutor(CORES, context) as processes,
    ):
        ways: dict[str, Executor] = {"one core": one, f"{CORES} threads": threads, f"{CORES} processes": processes}
        calls = {name: _all_joints(pool, recordings, seeds) for name, pool in ways.items()}
        for call in calls.values():
            call()  # loads the kernels, in every process
        found: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(rounds):
            for name, call in calls.items():
                found[name].append(once(call)[1].wall_s)
    return found


def _all_joints(pool: Executor, recordings: Sequence[Recording], seeds: Sequence[int]) -> Callable[[], list[int]]:
    return lambda: list(pool.map(fit_joint, recordings, seeds))


def table(scaling: Scaling) -> str:
    """Time and memory by length, then the six joints."""
    lines = [
        f"fit of Model 2 by the length of the window, medians over {len(SEEDS)} starts; processor time",
        f"{'samples':>8}{'converged':>11}{'iterations':>11}{'fit':>11}{'a sample and iteration':>24}{'memory':>11}",
    ]
    for row in scaling.lengths:
        each = 1e6 * row.fit.cpu_s / row.samples / row.iterations
        lines.append(
            f"{row.samples:>8}{f'{row.converged} of {row.starts}':>11}{row.iterations:>11.0f}"
            f"{1e3 * row.fit.cpu_s:>8.1f} ms{each:>21.2f} us{row.memory / 2**20:>8.1f} MB"
        )
    verdict = "met" if scaling.slope <= TARGET else "missed"
    lines += [
        f"time grows with the length to the power {scaling.slope:.2f} from {SLOPE_FROM} samples on, "
        f"target {TARGET}: {verdict}",
        "",
        f"{JOINTS} joints of {JOINT_SAMPLES} samples, wall time ({os.cpu_count()} cores)",
        f"{'':<14}{'median':>10}{'shortest':>10}{'gain':>7}",
    ]
    base = float(np.median(scaling.joints["one core"]))
    for name, times in scaling.joints.items():
        middle = float(np.median(times))
        lines.append(f"{name:<14}{1e3 * middle:>7.0f} ms{1e3 * min(times):>7.0f} ms{base / middle:>7.2f}")
    return "\n".join(lines) + "\n"
