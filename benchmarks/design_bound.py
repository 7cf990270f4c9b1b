"""By how much any motion of one joint can beat the multisine, as far as noise goes.

    setup/run python benchmarks/design_bound.py --workers 2 --write

Motions of 20 s at random, of one to six tones as large as the limits allow, have the informations M_i. That of a
mixture, which makes each for a share w_i of the time and loses none between them, is the sum of w_i M_i. The logarithm
of the geometric mean of the standard deviations is convex in it, so the best mixture is found for certain: by the
multiplicative algorithm (Silvey, Titterington & Torsney, Communications in Statistics A 7, 1978). By the equivalence
theorem (Kiefer & Wolfowitz, Canadian Journal of Mathematics 12, 1960) motions outside of it can raise the gain by a
factor of sqrt(d / k) at most, with k parameters and d = tr(G M) their largest sensitivity; d <= k for all motions of
the mixture. Further motions at random tell d.

Biases, as of smoothed friction, are left out: they come on top, whatever the motion is.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np
from design import CASES, PAGE, REACH, SECONDS, Case, fourier_search, multisine
from measured_blocks import add_options, rows_of, write
from peers.process import SINGLE_CORE

from joint_id_core.data.recording import Array
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.fourier_shapes import HIGHEST_HZ, STEEPEST, TONES, Shape
from joint_id_core.design.plant import SHARP
from joint_id_core.errors import JointIdError

BLOCK = "design-bound"
CALM_CASES = (3, 4)
PASSES, NEAR = 20000, 2e-3  # of the algorithm, and share of d by which it may miss


@dataclass(frozen=True)
class Row:
    """Geometric means of standard deviations by noise, and the largest d / k of motions that are not in the mixture."""

    case: str
    motions: int
    others: int
    multisine: float
    single: float
    mixture: float
    sensitivity: float


def covariances(job: tuple[Case, int, int]) -> list[Array]:
    """Covariances by noise alone, of the multisine first, of random motions."""
    case, count, seed = job
    near = replace(case.within, lower=np.array([-REACH]), upper=np.array([REACH]))
    search, shapes = fourier_search(case, near)
    foresight, rng = search.foresight, np.random.default_rng(seed)
    plain = multisine(case)
    moves = [(plain.position[:, 0], plain.velocity[:, 0])]
    for _ in range(count):
        tones = int(rng.integers(1, TONES + 1))
        frequencies = np.exp(rng.uniform(math.log(1.0 / SECONDS), math.log(HIGHEST_HZ), tones))
        waves = rng.standard_normal((2, tones)) * frequencies ** -rng.uniform(0.0, STEEPEST)
        found = search.candidate(Shape(frequencies, waves))
        if found is not None:
            moved = found.scale * shapes.moved(found.shape)
            moves.append((moved[0], moved[1]))
    seen = list[Array]()
    for position, velocity in moves:
        try:
            exact = foresight.move(search.joints[0], *map(np.ascontiguousarray, (position, velocity)), SHARP).recording
            both = [foresight.informed(search.joints[0], one)[0] for one in foresight.recordings(exact)]
        except JointIdError:
            continue
        seen.append((both[0] + both[1]) / 2.0)
    return seen


def row(case: Case, known: Sequence[Array], others: Sequence[Array]) -> Row:
    """The best mixture of motions with these covariances, the multisine first, held against those of others."""
    foresight = Foresight(case.model, case.settings)
    columns, prior = [foresight.free.index(n) for n in case.names], np.diag(foresight.coordinates.spread**-2.0)
    informations, fresh = ([np.linalg.inv(one) - prior for one in some] for some in (known, others))
    weights = np.full(len(known), 1.0 / len(known))
    for _ in range(PASSES):
        covariance = np.linalg.inv(np.tensordot(weights, informations, 1) + prior)
        half = covariance[:, columns] / np.sqrt(np.diag(covariance)[columns])
        sensitivity = np.einsum("nij,ik,jk->n", informations, half, half) / len(columns)
        if sensitivity.max() < 1.0 + NEAR:
            break
        weights = weights * sensitivity / (weights @ sensitivity)

    def mean(of: Array) -> float:
        return float(np.exp(0.5 * np.log(np.diag(of)[columns]).mean()))

    most = float(np.einsum("nij,ik,jk->n", fresh, half, half).max()) / len(columns)
    return Row(case.name, len(known), len(others), mean(known[0]), min(map(mean, known)), mean(covariance), most)


def measured(cases: Sequence[Case], motions: int, workers: int) -> Iterator[Row]:
    """The rows, half as many motions as those of the mixture held against it."""
    with get_context("spawn").Pool(workers) as pool:
        for case in cases:
            known, others = pool.map(covariances, [(case, motions, 1), (case, motions // 2, 2)], chunksize=1)
            yield row(case, known, others[1:])


def table(rows: Sequence[Row], machine: str) -> str:
    """The table in Markdown."""
    return "\n".join([
        machine,
        "",
        "| case | motions | multisine | best motion | best mixture | its gain | with further motions, at most |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(
            f"| {one.case} | {one.motions} | {one.multisine:.2%} | {one.single:.2%} | {one.mixture:.2%} | "
            f"{one.multisine / one.mixture:.2f} | "
            f"{one.multisine / one.mixture * math.sqrt(max(1.0, one.sensitivity)):.2f} ({one.others}) |"
            for one in rows
        ),
    ])  # fmt: skip


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--motions", type=int, default=400, help="at random, of each case (default: %(default)s)")
    add_options(parser, PAGE)
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    found = measured([CASES[k] for k in CALM_CASES], args.motions, args.workers)
    text = table(*rows_of(args, found, lambda of: Row(**of)))
    print(text)
    if args.write:
        write(PAGE, {BLOCK: text})


if __name__ == "__main__":
    main()
