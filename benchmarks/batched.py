"""The network on tensors of torch against the compiled kernel: the same passes in the same run, on CPU and GPU.

    setup/run python benchmarks/batched.py --docs

Both run passes of the innovations form with derivatives by parameters and noise levels, of Model 2 with all states
measured, at random parameters. Rounds alternate between them, and the fastest round counts. Times on a CPU are
processor time of all threads, since other programs may use the machine as well; beside it stands the wall time over
that of the kernel. Without a GPU its rows say so.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # a thread that waits must not take the processor from others

import measured_blocks
import numpy as np
import torch

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.search import Search
from joint_id_core.estimators.innovations.stages import TOLERANCE, Stages
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import KernelPasses, Passes, TorchPasses
from joint_id_core.estimators.many.starts import drawn
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion

SAMPLES, RATE, SUBSTEPS = 250, 500.0, 2
BATCHES, STARTS, ROUNDS = (100, 1000, 10000), 200, 3
MB = 2.0**20


@dataclass(frozen=True)
class Row:
    """A measurement.

    `rate`: passes (or searches) a second of processor time, on a GPU of wall time; `ratio`, `wall`: the same time, and
    wall time, over that of the compiled kernel; `difference`: the largest of a Gauss-Newton matrix, or the share of
    searches that ended elsewhere.
    """

    where: str
    batch: int
    rate: float
    ratio: float
    wall: float
    difference: float
    memory_mb: float


def problem() -> tuple[Stages, Array]:
    """Return the stages of one record, and its integrator steps."""
    model = build("harmonic_drive")
    data = prepare(model, simulate_motion(model, (SAMPLES - 1) / RATE, RATE, seed=1))
    search = Search(data, compile_model(model), Innovations(), None, lambda _: None)
    return search.stages, np.full(len(data.time), SUBSTEPS, dtype=np.int64)


def timed(work: Callable[[], object], on_gpu: bool = False) -> tuple[float, float]:
    """Return processor time (on a GPU wall time) and wall time of one call in s."""
    begun, processor = time.perf_counter(), time.process_time()
    work()
    if on_gpu:
        torch.cuda.synchronize()
    wall = time.perf_counter() - begun
    return (wall if on_gpu else time.process_time() - processor), wall


def kinds(recursions: list, steps: list) -> list[tuple[str, int, Passes]]:
    """Return what is compared with the kernel: name, threads, passes."""
    found: list[tuple[str, int, Passes]] = [
        (f"torch, CPU, {threads} thread{'s' * (threads > 1)}", threads, TorchPasses(recursions, steps, "torch"))
        for threads in (1, 2)
    ]
    if torch.cuda.is_available():
        name = torch.cuda.get_device_name()
        found.append((f"torch, {name}", 1, TorchPasses(recursions, steps, "cuda")))
    return found


def memory(where: str) -> float:
    """Return the largest memory so far in MB: of the process, or of the GPU's tensors."""
    if "CPU" in where or where.startswith("kernel"):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return torch.cuda.max_memory_allocated() / MB


def of_passes(batches: tuple[int, ...], rounds: int) -> list[Row]:
    """Measure passes at random parameters and noise levels."""
    stages, steps = problem()
    recursions, kernel = [stages.recursion], KernelPasses([stages.recursion], [steps])
    rows = []
    for batch in batches:
        print(f"passes of {batch}", flush=True)
        points = drawn(stages, batch, seed=batch)
        middle = stages.cost.belief.mean
        free = np.array([stages.coordinates.values(middle + 0.1 * (z - middle)) for z, _ in points])
        levels, record = np.array([level for _, level in points]), np.zeros(batch, dtype=np.int64)
        expected = list(kernel.run(record, free, levels))
        before = memory("kernel")
        others = kinds(recursions, [steps])
        times: dict[str, list[tuple[float, float]]] = {"kernel": []} | {where: [] for where, *_ in others}
        differences: dict[str, float] = {}
        held = {}
        for _ in range(rounds):
            times["kernel"].append(timed(lambda: list(kernel.run(record, free, levels))))  # noqa: B023  # called at once
            for where, threads, passes in others:
                torch.set_num_threads(threads)
                found: list = []
                times[where].append(timed(lambda: found.extend(passes.run(record, free, levels)), "CPU" not in where))  # noqa: B023
                held[where] = memory(where) - (before if "CPU" in where else 0.0)
                differences[where] = max(
                    float(np.max(np.abs(a.hessian - b.hessian)) / np.max(np.abs(b.hessian)))
                    for a, b in zip(found, expected, strict=True)
                    if np.isfinite(b.cost)
                )
        fastest, wall = map(min, zip(*times["kernel"], strict=True))
        rows.append(Row("compiled kernel, one core", batch, batch / fastest, 1.0, 1.0, 0.0, 0.0))
        for where, *_ in others:
            best, waited = map(min, zip(*times[where], strict=True))
            ratios = best / fastest, waited / wall
            rows.append(Row(where, batch, batch / best, *ratios, differences[where], held[where]))
    return rows


def of_starts(count: int) -> list[Row]:
    """Measure whole searches from random starts."""
    stages, steps = problem()
    jobs = [Start(0, stages.cost, stages.scoring, z, levels) for z, levels in drawn(stages, count, seed=0)]
    rows: list[Row] = []
    every = [("compiled kernel, one core", 1, KernelPasses([stages.recursion], [steps]))]
    every += [kind for kind in kinds([stages.recursion], [steps]) if "2 threads" not in kind[0]]
    reference: list = []
    first: tuple[float, float] | None = None
    for where, threads, passes in every:
        print(f"{count} starts, {where}", flush=True)
        torch.set_num_threads(threads)
        found: list = []
        took, waited = timed(
            lambda: found.extend(minimised(passes, jobs, [SUBSTEPS], TOLERANCE, 50)),  # noqa: B023  # called at once
            "torch" in where and "CPU" not in where,
        )
        reference = reference or found
        first = first or (took, waited)
        ratios = took / first[0], waited / first[1]
        rows.append(Row(where, count, count / took, *ratios, apart(found, reference), 0.0))
    return rows


def apart(found: list, reference: list) -> float:
    """Return the share of starts that ended more than a tenth of a standard deviation from where the kernel's ended."""
    other = 0
    for one, end in zip(found, reference, strict=True):
        if one is None or end is None:
            other += one is not end
            continue
        dz = one.z - end.z
        other += bool(dz @ end.hessian @ dz > 0.01)
    return other / len(found)


def table(passes: list[Row], starts: list[Row]) -> str:
    """Return the tables in Markdown."""
    lines = [
        "| passes | batch | a second | samples a second | time over the kernel's | wall time | difference | memory |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in passes:
        more = f"{r.difference:.0e} | {r.memory_mb:.0f} MB" if r.difference else "- | -"
        lines.append(
            f"| {r.where} | {r.batch} | {r.rate:.3g} | {r.rate * SAMPLES:.3g} | {r.ratio:.2g} | {r.wall:.2g} | {more} |"
        )
    none = "no GPU here"
    if not torch.cuda.is_available():
        lines.append(f"| torch, GPU | - | {none} | {none} | {none} | {none} | - | - |")
    lines += [
        "",
        "| searches | starts | a second | time over the kernel's | wall time | ended elsewhere |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {r.where} | {r.batch} | {r.rate:.3g} | {r.ratio:.2g} | {r.wall:.2g} | {r.difference:.1%} |" for r in starts
    ]
    if not torch.cuda.is_available():
        lines.append(f"| torch, GPU | - | {none} | {none} | {none} | - |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batches", type=int, nargs="+", default=BATCHES)
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/benchmarks.md")
    given = parser.parse_args()
    passes, starts = of_passes(tuple(given.batches), given.rounds), of_starts(given.starts)
    text = table(passes, starts)
    print(text)
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(
            json.dumps({"passes": [asdict(r) for r in passes], "starts": [asdict(r) for r in starts]})
        )
    if given.docs:
        measured_blocks.write("benchmarks.md", {"batched": text})


if __name__ == "__main__":
    main()
