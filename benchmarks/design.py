"""Whether designed motions keep their promise, and what they are worth beside a multisine of the same time and limits.

    setup/run python benchmarks/design.py --joints 200 --workers 2 --write
    python benchmarks/design.py --joints 200 --workers 14 --json design.json
    setup/run python benchmarks/design.py --from design.json --write

For each case a motion is designed for the start values. Joints whose values are off by 10 % make it, simulated with
exact stick and slip under position control, measured as a UR robot does, and are fitted from the start values. The
error is that of the estimate, in the logarithm for positive parameters; the promise is what the design said before. The
multisine has the tones of 1 to 3 Hz, of equal amplitude with Schroeder's phases, as large as the limits allow. Of a
design through waypoints the other motion is that through the same ones at one speed, as quick as the limits allow. The
last two commands measure on another machine, and write its tables where the docs are.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from typing import Any

import numpy as np
from measured_blocks import add_options, rows_of, write
from peers.process import SINGLE_CORE

from joint_id_core.data.recording import Array
from joint_id_core.design.design import Design
from joint_id_core.design.foresight import GUESS, Foresight
from joint_id_core.design.fourier_shapes import FourierShapes, Shape
from joint_id_core.design.joint import REACH, design_joint, foretell
from joint_id_core.design.limit_files import published
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.plant import as_recorded
from joint_id_core.design.search import Search
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.waypoint_shapes import WaypointShapes
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import Model, build
from joint_id_core.simulation.excitation import build_multisine, harmonics
from joint_id_core.simulation.position_control import simulate_closed_loop

JOINT, ROBOT, SECONDS = "elbow_joint", "ur3e", 20.0
PAGE, BLOCK, OF_WAYPOINTS = "benchmarks.md", "design-joint", "design-waypoints"
POSES = (-0.9, 0.2, 0.8)  # waypoints of a design, rad
CALM, BRISK = (5.0, 50.0), (20.0, 400.0)  # limits of acceleration and jerk, rad/s^2 and rad/s^3


@dataclass(frozen=True)
class Case:
    """A row: what is fitted, and the limits of acceleration and jerk beside those published of the robot's elbow."""

    name: str
    model: Model
    limits: tuple[float, float]
    show: tuple[str, ...] = ()
    settings: ParameterSettings = field(default_factory=ParameterSettings)
    through: tuple[float, ...] = ()

    @property
    def waypoints(self) -> Waypoints | None:
        """Those that the motion goes through, None for a Fourier series."""
        return Waypoints((JOINT,), np.array(self.through)[:, None]) if self.through else None

    @property
    def within(self) -> JointLimits:
        """All limits of the joint."""
        own = published(ROBOT).of((JOINT,))
        acceleration, jerk = self.limits
        return replace(own, acceleration=np.array([acceleration]), jerk=np.array([jerk]))

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that are shown."""
        free = Foresight(self.model, self.settings).free
        return self.show or tuple(n for n in free if not self.model.parameter(n).of_recording)


CASES = (
    *(
        Case(f"`{name}`, {what}", build(name), limits)
        for what, limits in (("brisk", BRISK), ("calm", CALM))
        for name in ("harmonic_drive", "motor_side", "rigid_joint")
    ),
    Case("`motor_side`, calm, for `tau_fm`, `c_m`", build("motor_side"), CALM, ("tau_fm", "c_m")),
    *(
        Case(f"`{name}`, {what}, waypoints at {', '.join(map(str, POSES))} rad", build(name), limits, through=POSES)
        for name, what, limits in (("motor_side", "calm", CALM), ("harmonic_drive", "brisk", BRISK))
    ),
)


class Sampled:
    """A trajectory as the reference of a controller that takes one sample a period."""

    def __init__(self, motion: Trajectory) -> None:
        self._rate, self._last = motion.rate, len(motion.time) - 1
        self._position, self._velocity = motion.position[:, 0].tolist(), motion.velocity[:, 0].tolist()

    def _at(self, instant: float) -> int:
        return min(round(instant * self._rate), self._last)

    def value(self, instant: float) -> float:
        """Position in rad."""
        return float(self._position[self._at(instant)])

    def rate(self, instant: float) -> float:
        """Velocity in rad/s."""
        return float(self._velocity[self._at(instant)])


def multisine(case: Case) -> Trajectory:
    """The multisine of 1 to 3 Hz within the limits."""
    tones = build_multisine(1.0, harmonics(1.0, 3.0, 5.0))
    sizes, phases = np.array(tones.amplitudes), np.array(tones.phases)
    shape = Shape(np.array(tones.frequencies), np.array([sizes * np.cos(phases), -sizes * np.sin(phases)]))
    own = case.within
    near = replace(own, lower=np.array([-REACH]), upper=np.array([REACH]))
    search, _ = fourier_search(case, near)
    found = search.candidate(shape)
    assert found is not None
    return search.trajectory(found, JOINT)


def at_one_speed(case: Case, waypoints: Waypoints) -> Trajectory:
    """The motion through waypoints at one speed, as often as the limits allow."""
    foresight = Foresight(case.model, case.settings)
    shapes = WaypointShapes(waypoints, case.within, SECONDS, foresight.rate)
    search = Search(foresight, shapes, case.within, SECONDS, case.names)
    found = search.candidate(shapes.plain(shapes.most))  # the limit of torque, too
    assert found is not None
    return search.trajectory(found, JOINT)


def fourier_search(case: Case, limits: JointLimits) -> tuple[Search, FourierShapes]:
    """A search among Fourier series about 0, and these."""
    foresight = Foresight(case.model, case.settings)
    shapes = FourierShapes(limits, 0.0, SECONDS, foresight.rate)
    return Search(foresight, shapes, limits, SECONDS, case.names), shapes


def off(case: Case, foresight: Foresight, seed: int) -> dict[str, float]:
    """Values of a joint that is off by `GUESS`."""
    rng, joint = np.random.default_rng([7, seed]), foresight.joints(0)[0]
    for p in {q.name: q for q in (*foresight.plant.model.parameters, *foresight.model.parameters)}.values():
        if p.positive and not p.fixed:
            joint[p.name] *= float(np.exp(GUESS * rng.standard_normal()))
    return joint


def error(job: tuple[Case, Trajectory, int]) -> tuple[str, list[float]]:
    """Status and errors, in estimation coordinates, of the fit of one joint."""
    case, motion, seed = job
    foresight = Foresight(case.model, case.settings)
    joint, plant = off(case, foresight, seed), foresight.plant
    values = {name: joint[name] for name in plant.model.parameter_names}
    exact = simulate_closed_loop(plant.model, plant.controller, Sampled(motion), motion.time, values)
    estimate = fit(case.model, as_recorded(exact, foresight.sensors, 1000 + seed), case.settings)
    at = foresight.coordinates
    found, truth = (np.array([one[n] for n in foresight.free]) for one in (estimate.values, joint))
    return estimate.status.value, (at.z(found) - at.z(truth)).tolist()


def promised(case: Case, design: Design) -> Array:
    """Promised standard deviations in estimation coordinates, of the parameters that are shown."""
    rows = {row.name: row for row in design.expected}
    return np.array([
        rows[n].std_dev / (rows[n].value if case.model.parameter(n).positive else 1.0) for n in case.names
    ])  # fmt: skip


@dataclass(frozen=True)
class Realised:
    """What became of the promises of a motion: rms errors by parameter, and how many fits converged."""

    promise: list[float]
    rms: list[float]
    converged: int


@dataclass(frozen=True)
class Row:
    """A row of a table: what became of the designed motion and of the other one; CPU seconds of the design."""

    case: str
    names: tuple[str, ...]
    joints: int
    designed: Realised
    other: Realised
    seconds: float


def motions(case: Case) -> tuple[Design, Design, float]:
    """Return the designed motion and the other one with their promises, and the CPU seconds of the design."""
    warm = Foresight(case.model, case.settings)
    angle = np.arange(round(SECONDS * warm.rate) + 1) / warm.rate
    warm.see(warm.joints(0)[0], 0.1 * np.sin(angle), 0.1 * np.cos(angle))  # compiled, loaded
    begun = time.process_time()
    through = case.waypoints
    design = design_joint(case.model, case.within, case.settings, SECONDS, case.show, waypoints=through)
    spent = time.process_time() - begun
    other = multisine(case) if through is None else at_one_speed(case, through)
    return design, foretell(Foresight(case.model, case.settings), other), spent


def realised(case: Case, design: Design, found: Sequence[tuple[str, list[float]]]) -> Realised:
    """Return what the fits of joints that made a motion say of its promise."""
    free = Foresight(case.model, case.settings).free
    errors = np.array([row for _, row in found])[:, [free.index(name) for name in case.names]]
    good = sum(status == "converged" for status, _ in found)
    return Realised(promised(case, design).tolist(), np.sqrt((errors**2).mean(axis=0)).tolist(), good)


def measured(cases: Sequence[Case], joints: int, workers: int) -> Iterator[Row]:
    """Design motions, and let joints make them and be fitted."""
    with get_context("spawn").Pool(workers) as pool:
        for case, (*designs, seconds) in zip(cases, pool.map(motions, cases, chunksize=1), strict=True):
            jobs = [(case, design.trajectory, seed) for design in designs for seed in range(joints)]
            found = pool.map(error, jobs, chunksize=1)
            both = (realised(case, d, found[k * joints : (k + 1) * joints]) for k, d in enumerate(designs))
            yield Row(case.name, case.names, joints, *both, seconds)


def geometric(values: Sequence[float]) -> float:
    """Geometric mean."""
    return float(np.exp(np.log(values).mean()))


def line(row: Row) -> str:
    """A line of the table."""
    found, other = row.designed, row.other
    ratio = np.divide(found.rms, found.promise).tolist()
    ratios = sorted(zip(ratio, row.names, strict=True))
    promise, gain = geometric(other.promise) / geometric(found.promise), geometric(other.rms) / geometric(found.rms)
    all_fits = other.converged == row.joints
    others = f"{geometric(other.rms):.2%}" if all_fits else f"{other.converged} of {row.joints} fits converge"
    return (
        f"| {row.case} | {found.converged} of {row.joints} | {ratios[0][0]:.2f} (`{ratios[0][1]}`) to "
        f"{ratios[-1][0]:.2f} (`{ratios[-1][1]}`), {geometric(ratio):.2f} | {geometric(found.promise):.2%}, "
        f"{geometric(found.rms):.2%} | {geometric(other.promise):.2%}, {others} | {promise:.2f}, "
        f"{f'{gain:.2f}' if all_fits else '-'} | {row.seconds:.1f} s |"
    )


def table(rows: Sequence[Row], machine: str, other: str = "multisine") -> str:
    """The table in Markdown, of rows whose other motion is called so."""
    joints = " or ".join(str(n) for n in sorted({row.joints for row in rows}))
    return "\n".join([
        f"Joints a case: {joints}. {machine}",
        "",
        "| case | converged | rms error over promise, least to most, mean | designed: promised, realised | "
        f"{other} | {other} over designed | time |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(line(row) for row in rows),
    ])  # fmt: skip


def of_json(row: dict[str, Any]) -> Row:
    """A row of a result in JSON."""
    return Row(**row | {part: Realised(**row[part]) for part in ("designed", "other")})


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--joints", type=int, default=200, help="of each case (default: %(default)s)")
    parser.add_argument("--cases", type=int, nargs="+", default=list(range(len(CASES))), help="numbers of the cases")
    add_options(parser, PAGE)
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    found = measured([CASES[k] for k in args.cases], args.joints, args.workers)
    rows, machine = rows_of(args, found, of_json)
    blocks = {BLOCK: ("multisine", False), OF_WAYPOINTS: ("one speed", True)}
    tables = {
        block: table(own, machine, other)
        for block, (other, through) in blocks.items()
        if (own := [row for row in rows if ("waypoints" in row.case) == through])
    }
    print(*tables.values(), sep="\n\n")
    if args.write:
        write(PAGE, tables)


if __name__ == "__main__":
    main()
