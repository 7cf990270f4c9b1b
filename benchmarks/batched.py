"""The network on tensors of torch against the compiled kernel: the same passes in the same run, on CPU and GPU.

    setup/run python benchmarks/batched.py --docs
    python benchmarks/batched.py --batches 100 1000 10000 100000 --starts 10000 --cores 16 --json gpu.json
    setup/run python benchmarks/batched.py --from gpu.json

Both run passes of the innovations form with derivatives by parameters and noise levels, of Model 2 with all states
measured, at random parameters. Rounds alternate between them, and the fastest round counts. Times on a CPU are
processor time of all threads, since other programs may use the machine as well; beside it stands the wall time over
that of the kernel. Without a GPU its rows say so. The last two commands measure on a machine with a GPU, and write its
tables where the docs are.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import chain
from multiprocessing import get_context
from multiprocessing.synchronize import Barrier
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # a thread that waits must not take the processor from others

import measured_blocks
import numpy as np
import torch
from peers.process import SINGLE_CORE

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.search import APART, Search
from joint_id_core.estimators.innovations.stages import TOLERANCE, Stages
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import KernelPasses, Passes, TorchPasses
from joint_id_core.estimators.many.starts import drawn
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion

SAMPLES, RATE, SUBSTEPS = 250, 500.0, 2
BATCHES, STARTS, ROUNDS = (100, 1000, 10000), 200, 3
CPU_MOST = 10000  # passes beyond which torch on a CPU is left out: it takes minutes and says nothing new
MAX_ITERATIONS = 50  # of a search
PARTS = 8  # of the starts, for each core
MB = 2.0**20
OTHER = "batched-gpu"  # the measured block of a machine with a GPU


@dataclass(frozen=True)
class Row:
    """A measurement.

    `rate`: passes (or searches) a second of processor time, on a GPU and several cores of wall time; `ratio`, `wall`:
    the same time, and wall time, over that of the compiled kernel; `difference`: the median of a Gauss-Newton matrix,
    or the share of searches that ended elsewhere; `best`: the share of searches that reached the best minimum.
    """

    where: str
    batch: int
    rate: float
    ratio: float
    wall: float
    difference: float
    memory_mb: float
    best: float = 0.0


@cache
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


def kinds(recursions: list, steps: list, threads_of_cpu: tuple[int, ...]) -> list[tuple[str, int, Passes]]:
    """Return what is compared with the kernel: name, threads, passes."""
    found: list[tuple[str, int, Passes]] = [
        (f"torch, CPU, {threads} thread{'s' * (threads > 1)}", threads, TorchPasses(recursions, steps, "torch"))
        for threads in threads_of_cpu
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


def of_passes(batches: Sequence[int], rounds: int, cpu_most: int = CPU_MOST) -> Iterator[Row]:
    """Measure passes at random parameters and noise levels."""
    stages, steps = problem()
    recursions, kernel = [stages.recursion], KernelPasses([stages.recursion], [steps])
    for batch in batches:
        print(f"passes of {batch}", flush=True)
        if torch.cuda.is_available():
            torch.cuda.reset_peak_memory_stats()
        on_cpu = (1, 2) if batch <= cpu_most else ()
        points = drawn(stages, batch, seed=batch)
        middle = stages.cost.belief.mean
        free = np.array([stages.coordinates.values(middle + 0.1 * (z - middle)) for z, _ in points])
        levels, record = np.array([level for _, level in points]), np.zeros(batch, dtype=np.int64)
        expected = list(kernel.run(record, free, levels))
        before = memory("kernel")
        others = kinds(recursions, [steps], on_cpu)
        times: dict[str, list[tuple[float, float]]] = {"kernel": []} | {where: [] for where, *_ in others}
        differences: dict[str, float] = {}
        held = {}
        for _ in range(rounds):
            times["kernel"].append(timed(lambda: list(kernel.run(record, free, levels))))  # noqa: B023  # called at once
            for where, threads, passes in others:
                torch.set_num_threads(threads)
                found: list = []
                times[where].append(timed(lambda: found.extend(passes.run(record, free, levels)), "CPU" not in where))  # noqa: B023  # called at once
                held[where] = memory(where) - (before if "CPU" in where else 0.0)
                differences[where] = float(
                    np.median(
                        [
                            np.max(np.abs(a.hessian - b.hessian)) / np.max(np.abs(b.hessian))
                            for a, b in zip(found, expected, strict=True)
                            if np.isfinite(b.cost)
                        ]
                    )
                )
        fastest, wall = map(min, zip(*times["kernel"], strict=True))
        yield Row("compiled kernel, one core", batch, batch / fastest, 1.0, 1.0, 0.0, 0.0)
        for where, *_ in others:
            best, waited = map(min, zip(*times[where], strict=True))
            ratios = best / fastest, waited / wall
            yield Row(where, batch, batch / best, *ratios, differences[where], held[where])


def of_starts(count: int, cores: int = 1, cpu_most: int = CPU_MOST) -> Iterator[Row]:
    """Measure whole searches from random starts."""
    at_once = on_cores(count, cores) if cores > 1 else ()
    stages, steps = problem()
    jobs = jobs_of(stages, count)
    every = [("compiled kernel, one core", 1, KernelPasses([stages.recursion], [steps]))]
    every += kinds([stages.recursion], [steps], (1,) if count <= cpu_most else ())
    reference: list = []
    first: tuple[float, float] | None = None
    for where, threads, passes in every:
        print(f"{count} starts, {where}", flush=True)
        torch.set_num_threads(threads)
        found: list = []
        times = timed(
            lambda: found.extend(minimised(passes, jobs, [SUBSTEPS], TOLERANCE, MAX_ITERATIONS)),  # noqa: B023  # called at once
            "torch" in where and "CPU" not in where,
        )
        reference, first = reference or found, first or times
        yield compared(where, found, times, first, reference)
    if at_once:
        yield compared(f"compiled kernel, {cores} cores", *at_once, first or (0.0, 0.0), reference)


def on_cores(count: int, cores: int) -> tuple[list, tuple[float, float]]:
    """Search with the kernel from `count` starts on several cores; return the ends, and the wall time twice."""
    os.environ.update(SINGLE_CORE)
    parts = [range(k, count, PARTS * cores) for k in range(PARTS * cores)]
    context = get_context("spawn")
    with context.Pool(cores, initializer=ready, initargs=(context.Barrier(cores),)) as pool:
        pool.map(len, parts)  # returns when every process is ready
        begun = time.perf_counter()
        ends = pool.starmap(searched, [(part, count) for part in parts], chunksize=1)
        waited = time.perf_counter() - begun
    found: list = [None] * count
    for part, some in zip(parts, ends, strict=True):
        found[part.start :: part.step] = some
    return found, (waited, waited)


def jobs_of(stages: Stages, count: int) -> list[Start]:
    """Return starts drawn from the prior."""
    return [Start(0, stages.cost, stages.scoring, z, levels) for z, levels in drawn(stages, count, seed=0)]


def ready(all_of_them: Barrier) -> None:
    """Make the problem in a process, and wait for the others."""
    problem()
    all_of_them.wait()


def searched(chosen: Sequence[int], count: int) -> list[Minimum | None]:
    """Search with the kernel from the starts `chosen` of `count`."""
    stages, steps = problem()
    jobs, passes = jobs_of(stages, count), KernelPasses([stages.recursion], [steps])
    return minimised(passes, [jobs[k] for k in chosen], [SUBSTEPS], TOLERANCE, MAX_ITERATIONS)


def compared(where: str, found: list, times: tuple[float, float], first: tuple[float, float], reference: list) -> Row:
    """Return the row of searches that ended at `found`, while the kernel took the times `first` to its `reference`."""
    best = min((end for end in reference if end is not None), key=lambda end: end.cost)
    reached = [end is not None and away(end, best) < APART for end in found]
    of_kernel = [(one, end) for one, end in zip(found, reference, strict=True) if end and away(end, best) < APART]
    elsewhere = sum(one is None or away(one, end) > 0.1 for one, end in of_kernel) / len(of_kernel)
    ratios = times[0] / first[0], times[1] / first[1]
    return Row(where, len(found), len(found) / times[0], *ratios, elsewhere, 0.0, sum(reached) / len(found))


def away(one: Minimum, end: Minimum) -> float:
    """Return the distance of two ends in standard deviations."""
    dz = one.z - end.z
    return float(np.sqrt(dz @ end.hessian @ dz))


def table(passes: Sequence[Row], starts: Sequence[Row], machine: str = "") -> str:
    """Return the tables in Markdown."""
    lines = [machine, ""] * bool(machine) + [
        "| passes | batch | a second | samples a second | time over the kernel's | wall time | difference | memory |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in passes:
        more = f"{r.difference:.0e} | " if r.difference else "- | "
        more += f"{r.memory_mb:.2g} MB" if 0.0 < r.memory_mb < 10.0 else f"{r.memory_mb:.0f} MB" if r.memory_mb else "-"
        lines.append(
            f"| {r.where} | {r.batch} | {r.rate:.3g} | {r.rate * SAMPLES:.3g} | {r.ratio:.2g} | {r.wall:.2g} | {more} |"
        )
    none, on_gpu = "no GPU here", any("torch" in r.where and "CPU" not in r.where for r in passes)
    if not on_gpu:
        lines.append(f"| torch, GPU | - | {none} | {none} | {none} | {none} | - | - |")
    lines += [
        "",
        "| searches | starts | a second | time over the kernel's | wall time | ended elsewhere | at the best minimum |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {r.where} | {r.batch} | {r.rate:.3g} | {r.ratio:.2g} | {r.wall:.2g} | {r.difference:.1%} | {r.best:.1%} |"
        for r in starts
    ]
    if not on_gpu:
        lines.append(f"| torch, GPU | - | {none} | {none} | {none} | - | - |")
    return "\n".join(lines)


def machine() -> str:
    """Return in words where this runs."""
    gpu = f", one {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return f"{os.cpu_count()} cores{gpu}, torch {torch.__version__}, NumPy {np.__version__}."


def main() -> None:
    """Measure, print, and write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batches", type=int, nargs="+", default=BATCHES)
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--cores", type=int, default=1, help="on which the kernel searches as well")
    parser.add_argument("--cpu-most", type=int, default=CPU_MOST, help="passes or starts that torch does on a CPU")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--from", type=Path, dest="result", help=f"a JSON, for the block {OTHER}: measure nothing")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/benchmarks.md")
    given = parser.parse_args()
    if given.result:
        known = json.loads(given.result.read_text())
        parts = [[Row(**row) for row in known[part]] for part in ("passes", "starts")]
        measured_blocks.write("benchmarks.md", {OTHER: table(*parts, known["machine"])})
        return
    rows: dict[str, list[Row]] = {"passes": [], "starts": []}
    for part, row in chain(
        (("starts", row) for row in of_starts(given.starts, given.cores, given.cpu_most)),
        (("passes", row) for row in of_passes(given.batches, given.rounds, given.cpu_most)),
    ):
        rows[part].append(row)
        if given.json:  # a run that is stopped keeps what it has
            given.json.parent.mkdir(parents=True, exist_ok=True)
            known = {"machine": machine()} | {name: [asdict(r) for r in some] for name, some in rows.items()}
            given.json.write_text(json.dumps(known))
    text = table(rows["passes"], rows["starts"])
    print(text)
    if given.docs:
        measured_blocks.write("benchmarks.md", {"batched": text})


if __name__ == "__main__":
    main()
