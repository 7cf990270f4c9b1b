"""How large the errors of fits of whole arms are beside the sigma they predict, and how often their intervals hold.

    setup/run python benchmarks/arm_stats.py --arms 24 --write

`designed_arms.arms` says what is simulated: arms whose dynamics are those of MuJoCo, and which differ from their
description. Each makes two random motions free and one with a payload. One fit has the right gains and weighs the
payload; in the other they are wrong by 15 %, and the weighed mass tells them. Half of the arms have friction that
bends. With n errors a ratio is known to 0.7 / sqrt(n), and a coverage to 0.22 / sqrt(n), if they do not hang together.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context

from measured_blocks import add_options, rows_of, write
from peers.process import SINGLE_CORE

os.environ.update(SINGLE_CORE)  # libraries read this when they are imported

import numpy as np
from designed_arms.arms import SIZES, Described, TrueArm, near
from designed_arms.runs import GAINS, TONES, drawn

from joint_id_core.arm.arm_estimate import ArmEstimate, Value
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.design.arm_design import REACH
from joint_id_core.results.verdict import Verdict
from joint_id_core.rtde.fields import JOINT_NAMES

PAGE, BLOCK = "benchmarks.md", "arm-stats"
BASE = "base parameters"
INTERVAL = 1.959964  # standard deviations: 95 %
WRONG = 0.15  # standard deviation of the logarithm of assumed gains
SEEDS = 7000  # of the first description; others draw from lower ones
LINK = (
    '<link name="payload"><inertial><origin xyz="{} {} {}"/><mass value="{}"/>'
    '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="grip" type="fixed"><parent link="link_5"/><child link="payload"/></joint></robot>'
)


@dataclass(frozen=True)
class Row:
    """What fits of one arm found, by group of parameters.

    Attributes:
        size, bent: of the arm, and whether its friction bends.
        errors, sigmas, truths: of base parameters, and of others that are `estimated`.
        all: how many parameters there are.
    """

    size: str
    bent: bool
    errors: dict[str, list[float]]
    sigmas: dict[str, list[float]]
    truths: dict[str, list[float]]
    all: dict[str, int]

    @classmethod
    def of(cls, size: str, bent: bool, found: dict[str, Sequence[tuple[Value, float]]]) -> Row:
        """Return it from estimates and truths."""
        known = {n: {Verdict.ESTIMATED, Verdict.PRIOR} if n == BASE else {Verdict.ESTIMATED} for n in found}
        told = {n: [(v, t) for v, t in pairs if v.verdict in known[n]] for n, pairs in found.items()}
        return cls(
            size, bent,
            {n: [v.value - t for v, t in pairs] for n, pairs in told.items()},
            {n: [v.std_dev for v, _ in pairs] for n, pairs in told.items()},
            {n: [t for _, t in pairs] for n, pairs in told.items()},
            {n: len(pairs) for n, pairs in found.items()},
        )  # fmt: skip

    def __str__(self) -> str:
        """Return rms errors over sigma."""
        return f"{self.size}: " + ", ".join(
            f"{n} {np.sqrt(np.mean((np.array(e) / self.sigmas[n]) ** 2)):.2f}" for n, e in self.errors.items() if e
        )


def fitted(number: int) -> Row:
    """Simulate an arm and fit it."""
    size, bent, seed = tuple(SIZES)[number % len(SIZES)], bool(number // len(SIZES) % 2), SEEDS + number
    described = Described.drawn(size, seed)
    description, rng = described.description(), np.random.default_rng(seed)
    regressor = Regressor(description)
    arm = TrueArm.drawn(described, regressor, seed, bent)
    held = near(described.limits(), REACH)
    motions = [drawn(held, TONES, 10 * seed + k) for k in range(3)]
    mass = float(SIZES[size][1][1] * rng.uniform(0.1, 0.3))  # a share of that of the upper arm
    centre = rng.uniform([-0.05, -0.05, 0.03], [0.05, 0.05, 0.12])
    held_body = LINK.format(*centre, mass, i=4e-4 * mass)
    carrying = replace(arm, urdf=arm.urdf.replace("</robot>", held_body))
    free = [arm.recorded(motion, 10 * seed + k) for k, motion in enumerate(motions[:2])]
    loaded = [carrying.recorded(motions[2], 10 * seed + 2)]
    found = fit_arm(description, free, GAINS, payload=loaded)
    assumed = np.exp(WRONG * rng.standard_normal(len(JOINT_NAMES)))
    wrong = {name: {"torque": float(gain)} for name, gain in zip(JOINT_NAMES, assumed, strict=True)}
    weighed = fit_arm(description, free, wrong, payload=loaded, mass=mass)
    return Row.of(size, bent, {**_of_arm(found, regressor, arm), **_of_payload(found, weighed, mass, centre, assumed)})


def _of_arm(found: ArmEstimate, regressor: Regressor, arm: TrueArm) -> dict[str, Sequence[tuple[Value, float]]]:
    """Return estimates and truths of links and joints."""
    base = [Value(p.value, p.std_dev, "", p.verdict, "") for p in found.parameters]
    truth, count = arm.values, len(JOINT_NAMES)
    rotors = truth[:count] - regressor.reference[:count]
    return {
        BASE: list(zip(base, truth.tolist(), strict=False)),
        f"{BASE}, estimated": list(zip(base, truth.tolist(), strict=False)),
        "rotor inertia": [(j.armature, float(t)) for j, t in zip(found.joints, rotors, strict=True)],
        "viscous friction": [(j.damping, float(t)) for j, t in zip(found.joints, truth[-2 * count :], strict=False)],
        "Coulomb friction": [(j.friction, float(t)) for j, t in zip(found.joints, truth[-count:], strict=True)],
    }


def _of_payload(
    found: ArmEstimate, weighed: ArmEstimate, mass: float, centre: Array, assumed: Array
) -> dict[str, Sequence[tuple[Value, float]]]:
    """Return estimates and truths of the payload and of the gains."""
    payload = found.payload
    assert payload is not None
    verdict = Verdict.ESTIMATED if payload.known else Verdict.PRIOR
    places = zip(payload.centre, payload.centre_std_dev, centre.tolist(), strict=True)
    factors = [Value(f.value, f.std_dev, "", Verdict.ESTIMATED, "") for f in weighed.factors]
    return {
        "payload, mass": [(Value(payload.mass, payload.mass_std_dev, "kg", verdict, ""), mass)],
        "payload, centre": [(Value(v, s, "m", verdict, ""), t) for v, s, t in places],
        "gains": list(zip(factors, (1.0 / assumed).tolist(), strict=True)),
    }


def measured(arms: int, workers: int) -> Iterator[Row]:
    """Yield what becomes of every arm."""
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(fitted, range(arms))


def table(rows: Sequence[Row], machine: str) -> str:
    """Return the table in Markdown: a row for each group of parameters, friction that bends apart."""
    head = ["", "values", "rms error / sigma", "coverage", "sigma, median"]
    kinds = [("straight", False), ("bends", True)]
    lines = [machine, ""]
    cells = ["of arms", *(f"{h}, friction {kind}" if h else "" for kind, _ in kinds for h in head[1:])]
    lines += ["| " + " | ".join(cells) + " |", "| " + " | ".join("---" for _ in cells) + " |"]
    for group in rows[0].errors:
        own = [_cells([row for row in rows if row.bent is bent], group) for _, bent in kinds]
        lines.append(f"| {group} | " + " | ".join(cell for some in own for cell in some) + " |")
    return "\n".join(lines)


def _cells(rows: Sequence[Row], group: str) -> list[str]:
    """Return how many values there are, rms error over sigma, coverage, and the median sigma as share of the truth."""
    error, sigma, truth = (_all(getattr(row, name)[group] for row in rows) for name in ("errors", "sigmas", "truths"))
    z = error / sigma
    return [
        f"{len(z)} of {sum(row.all[group] for row in rows)}", f"{np.sqrt(np.mean(z**2)):.2f}",
        f"{np.mean(np.abs(z) < INTERVAL):.3f}", f"{100.0 * np.median(sigma / np.abs(truth)):.2g} %",
    ]  # fmt: skip


def _all(parts: Iterable[Sequence[float]]) -> Array:
    return np.concatenate([np.asarray(part, dtype=float) for part in parts])


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--arms", type=int, default=24, help="how many, of three sizes (default: %(default)s)")
    add_options(parser, PAGE)
    args = parser.parse_args()
    text = table(*rows_of(args, measured(args.arms, args.workers), lambda row: Row(**row)))
    print(text)
    if args.write:
        write(PAGE, {BLOCK: text})


if __name__ == "__main__":
    main()
