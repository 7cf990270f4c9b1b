"""Whether designed motions keep their promise, and what they are worth beside a multisine of the same time and limits.

    setup/run python benchmarks/design.py --joints 200 --workers 2

For each case a motion is designed for the start values. Joints whose values are off by 10 % make it, simulated with
exact stick and slip under position control, measured as a UR robot does, and are fitted from the start values. The
error is that of the estimate, in the logarithm for positive parameters; the promise is what the design said before. The
multisine has the tones of 1 to 3 Hz, of equal amplitude with Schroeder's phases, as large as the limits allow.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from multiprocessing import get_context

import numpy as np
from measured_blocks import write
from peers.process import SINGLE_CORE

from joint_id_core.data.recording import Array
from joint_id_core.design.design import Design
from joint_id_core.design.foresight import GUESS, Foresight
from joint_id_core.design.joint import REACH, design_joint, foretell
from joint_id_core.design.limit_files import published
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.plant import as_recorded
from joint_id_core.design.search import Search, Shape
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import Model, build
from joint_id_core.simulation.excitation import build_multisine, harmonics
from joint_id_core.simulation.position_control import simulate_closed_loop

JOINT, ROBOT, SECONDS = "elbow_joint", "ur3e", 20.0
PAGE, BLOCK = "benchmarks.md", "design-joint"
CALM, BRISK = (5.0, 50.0), (20.0, 400.0)  # limits of acceleration and jerk, rad/s^2 and rad/s^3


@dataclass(frozen=True)
class Case:
    """A row: what is fitted, and the limits of acceleration and jerk beside those published of the robot's elbow."""

    name: str
    model: Model
    limits: tuple[float, float]
    show: tuple[str, ...] = ()
    settings: ParameterSettings = field(default_factory=ParameterSettings)

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
    search = Search(Foresight(case.model, case.settings), near, 0.0, SECONDS, case.names)
    found = search.candidate(shape)
    assert found is not None
    return search.motion(found, JOINT).sampled(search.foresight.rate)


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
    """What became of a promise: rms errors over it by parameter, and how many fits converged."""

    promise: Array
    rms: Array
    converged: int

    @property
    def ratio(self) -> Array:
        """Realised over promised."""
        return np.asarray(self.rms / self.promise)


def realised(case: Case, design: Design, seeds: Sequence[int], workers: int) -> Realised:
    """Let many joints make a motion, and fit them."""
    jobs = [(case, design.trajectory, seed) for seed in seeds]
    with get_context("spawn").Pool(workers) as pool:
        found = pool.map(error, jobs, chunksize=1)
    free = Foresight(case.model, case.settings).free
    columns = [free.index(name) for name in case.names]
    errors = np.array([row for _, row in found])[:, columns]
    good = sum(status == "converged" for status, _ in found)
    return Realised(promised(case, design), np.sqrt((errors**2).mean(axis=0)), good)


def geometric(values: Array) -> float:
    """Geometric mean."""
    return float(np.exp(np.log(values).mean()))


def row(case: Case, seeds: Sequence[int], workers: int) -> str:
    """A row of the table."""
    warm = Search(Foresight(case.model, case.settings), case.within, 0.0, SECONDS, case.names)
    warm.foresight.see(warm.joints[0], 0.1 * np.sin(warm.time), 0.1 * np.cos(warm.time))  # compiled, loaded
    begun = time.process_time()
    design = design_joint(case.model, case.within, case.settings, SECONDS, case.show)
    spent = time.process_time() - begun
    plain = foretell(Foresight(case.model, case.settings), multisine(case))
    found, other = (realised(case, d, seeds, workers) for d in (design, plain))
    ratios = sorted(zip(found.ratio.tolist(), case.names, strict=True))
    promise, gain = geometric(other.promise) / geometric(found.promise), geometric(other.rms) / geometric(found.rms)
    print(case.name, {n: round(r, 2) for r, n in ratios}, "multisine", np.round(other.ratio, 2), flush=True)
    text = (
        f"| {case.name} | {found.converged} of {len(seeds)} | {ratios[0][0]:.2f} (`{ratios[0][1]}`) to "
        f"{ratios[-1][0]:.2f} (`{ratios[-1][1]}`), {geometric(found.ratio):.2f} | {geometric(found.promise):.2%}, "
        f"{geometric(found.rms):.2%} | {geometric(other.promise):.2%}, {geometric(other.rms):.2%} | {promise:.2f}, "
        f"{gain:.2f} | {spent:.1f} s |"
    )
    print(text, flush=True)
    return text


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--joints", type=int, default=200, help="of each case (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--cases", type=int, nargs="+", default=list(range(len(CASES))), help="numbers of the cases")
    parser.add_argument("--write", action="store_true", help=f"make the table of docs/{PAGE} anew")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    rows = [
        f"Joints a case: {args.joints}.",
        "",
        "| case | converged | rms error over promise, least to most, mean | designed: promised, realised | multisine | "
        "multisine over designed | time |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(row(CASES[k], range(args.joints), args.workers) for k in args.cases),
    ]
    print("\n".join(rows))
    if args.write:
        write(PAGE, {BLOCK: "\n".join(rows)})


if __name__ == "__main__":
    main()
