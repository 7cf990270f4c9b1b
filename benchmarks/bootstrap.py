"""How often 95 % intervals contain the truth: those of the bootstrap, and those of the standard deviations of fits.

    setup/run python benchmarks/bootstrap.py --records 200 --workers 2 --write
    python benchmarks/bootstrap.py --records 200 --workers 14 --json bootstrap.json
    setup/run python benchmarks/bootstrap.py --from bootstrap.json --write

Records of one motion of `rigid_joint` (2 s at 125 Hz) differ in their noise. It is white, or it has a memory: the noise
of position and torque is that of a filter of first order with a time constant of 10 ms, as large as the white one.
Blocks are longer than that, as the bootstrap asks for. The joint has the friction of the model, smoothed as in a fit,
so that intervals which know noise alone can hold the truth; or it sticks, which moves all estimates alike.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context

import numpy as np
from measured_blocks import add_options, rows_of, write
from peers.process import SINGLE_CORE
from scipy.integrate import solve_ivp

from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators.many.bootstrap import bootstrap
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.sensors import ur_robot_sensors

MODEL, SECONDS, RATE = build("rigid_joint"), 2.0, 125.0
MEMORY_S, BLOCK_S, DRAWS = 0.01, 0.05, 200
PAGE, BLOCK = "benchmarks.md", "bootstrap"
NORMAL = 1.959964  # quantile of a 95 % interval


@dataclass(frozen=True)
class Case:
    """A row: time constant of the noise in s, and whether the joint sticks."""

    name: str
    memory_s: float
    sticks: bool


CASES = (
    Case("white", 0.0, False),
    Case("memory of 10 ms", MEMORY_S, False),
    Case("white, the joint sticks", 0.0, True),
)


@dataclass(frozen=True)
class One:
    """What one record says, by parameter: errors of the estimate and of the ends of its interval, deviations."""

    error: list[float]
    lower: list[float]
    upper: list[float]
    scatter: list[float]
    noise: list[float]
    std_dev: list[float]


def recorded(case: Case, seed: int) -> Recording:
    """Return what is measured of a motion; the position keeps its resolution."""
    exact = simulate_motion(MODEL, SECONDS, RATE, noise=False) if case.sticks else smooth()
    sensors, names = ur_robot_sensors(), ("link_position", "torque")
    keep = math.exp(-1.0 / (RATE * case.memory_s)) if case.memory_s else 0.0
    channels = {}
    for name, rng in zip(names, np.random.default_rng(seed).spawn(2), strict=True):
        noise = sensors.noise[name] * rng.standard_normal(len(exact.time))
        for t in range(1, len(noise)):
            noise[t] = keep * noise[t - 1] + math.sqrt(1.0 - keep**2) * noise[t]
        channels[name] = exact[name] + noise
        if quantum := sensors.quantum.get(name):
            channels[name] = np.round(channels[name] / quantum) * quantum
    return replace(exact, channels=channels)


@cache
def smooth() -> Recording:
    """Return the exact values of the same motion, with the friction that a fit has.

    The error of the integration is far below what a fit can see: that of fixed steps, at reversals of such steep
    friction, is not.
    """
    p, time = MODEL.values(), np.arange(round(SECONDS * RATE) + 1) / RATE
    reference, controller = position_reference(), controller_of(MODEL, MODEL.values())
    wanted, rates = reference.value(time), reference.rate(time)
    states, torques, state = [], [], np.array([wanted[0], 0.0])

    def slope(_: float, x: Array, torque: float) -> list[float]:
        friction = p["c"] * x[1] + p["tau_f"] * math.tanh(x[1] / p["w_s"]) + p["tau_0"]
        return [x[1], (torque - friction) / p["J"]]

    for q, dq in zip(wanted.tolist(), rates.tolist(), strict=True):
        torque = controller.k_p * (q - state[0]) + controller.k_d * (dq - state[1])
        states.append(state)
        torques.append(torque)
        span = (0.0, 1.0 / RATE)
        state = solve_ivp(slope, span, state, "DOP853", args=(torque,), rtol=1e-11, atol=1e-13).y[:, -1]
    position, velocity = np.array(states).T
    return Recording(time, {"link_position": position, "link_velocity": velocity, "torque": np.array(torques)})


def one(job: tuple[Case, int]) -> One:
    """Fit a record, with its bootstrap."""
    import torch

    torch.set_num_threads(1)
    case, seed = job
    truth, rows = MODEL.values(), bootstrap(MODEL, recorded(case, seed), draws=DRAWS, block_s=BLOCK_S).intervals
    return One(
        [i.value - truth[i.name] for i in rows],
        [i.lower - truth[i.name] for i in rows],
        [i.upper - truth[i.name] for i in rows],
        [i.scatter for i in rows],
        [i.noise for i in rows],
        [i.std_dev for i in rows],
    )


@dataclass(frozen=True)
class Row:
    """A row of the table, each list by parameter: shares of intervals that hold the truth, and rms errors over the root
    mean square of the deviations."""

    noise: str
    records: int
    names: list[str]
    by_draws: list[float]
    by_deviation: list[float]
    over_scatter: list[float]
    over_noise: list[float]
    over_deviation: list[float]


def row(case: Case, found: Sequence[One]) -> Row:
    """Count."""
    error, lower, upper, scatter, noise, std_dev = (
        np.array([getattr(o, name) for o in found])
        for name in ("error", "lower", "upper", "scatter", "noise", "std_dev")
    )
    shares = ((lower <= 0.0) & (upper >= 0.0), np.abs(error) <= NORMAL * std_dev)
    rms = np.sqrt((error**2).mean(axis=0))
    return Row(
        case.name, len(found), [p.name for p in MODEL.parameters if not p.fixed],
        *(share.mean(axis=0).tolist() for share in shares),
        *((rms / np.sqrt((part**2).mean(axis=0))).tolist() for part in (scatter, noise, std_dev)),
    )  # fmt: skip


def measured(cases: Sequence[Case], records: int, workers: int) -> Iterator[Row]:
    """Measure case by case."""
    with get_context("spawn").Pool(workers) as pool:
        for case in cases:
            yield row(case, pool.map(one, [(case, seed) for seed in range(records)], chunksize=1))


def table(rows: Sequence[Row], machine: str) -> str:
    """The table in Markdown."""

    def span(values: Sequence[float], form: str) -> str:
        return f"{min(values):{form}} to {max(values):{form}}"

    return "\n".join([
        machine,
        "",
        "| noise | records | 95 % of the draws hold the truth | 1.96 standard deviations hold it | rms error over the "
        "scatter of draws | over the part of noise | over the standard deviation |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(
            f"| {r.noise} | {r.records} | {span(r.by_draws, '.0%')} | {span(r.by_deviation, '.0%')} | "
            f"{span(r.over_scatter, '.2f')} | {span(r.over_noise, '.2f')} | {span(r.over_deviation, '.2f')} |"
            for r in rows
        ),
    ])  # fmt: skip


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--records", type=int, default=200, help="of each case (default: %(default)s)")
    parser.add_argument("--cases", type=int, nargs="+", default=list(range(len(CASES))), help="numbers of the rows")
    add_options(parser, PAGE)
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    found = measured([CASES[k] for k in args.cases], args.records, args.workers)
    text = table(*rows_of(args, found, lambda row: Row(**row)))
    print(text)
    if args.write:
        write(PAGE, {BLOCK: text})


if __name__ == "__main__":
    main()
