"""A thousand simulated bags through `joint-id batch`: share of ideal speed, overhead of a bag, memory.

    setup/run python benchmarks/batch.py --bags 1000 --jobs 2

Ideal is what reading and fitting of the same bags take in one process that does nothing else, over the number of
processes. Beside the wall time, which others on the computer lengthen, processor time is told: of the batch with all of
its processes, with their start and the libraries and kernels that they load.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import numpy as np
from measured_blocks import write

from joint_id_core import formats
from joint_id_core.batch.recordings import find
from joint_id_core.batch.work import Work
from joint_id_core.estimators import ParameterSettings, build
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.models import build as build_model
from joint_id_core.simulation.motion import simulate_motion

MODEL, RATE, SECONDS, JOINTS = "rigid_joint", 250.0, 8.0, 1
DIFFERENT = 8  # bags that are simulated; the others are copies, and are read and fitted all the same
WARM_UP = 3  # bags that load libraries and kernels
PACE_S = 0.5  # between two looks at the memory
PART = 0.2  # of the time at the begin and at the end whose memory is compared
COMMAND = ("-c", "from joint_id_core.cli import main; main()", "batch", "--model", MODEL, "--json")


@dataclass(frozen=True)
class Figures:
    """Times in s a bag; memory in MB of the process that leads and of the largest one that works, at begin and end."""

    bags: int
    jobs: int
    alone_cpu_s: float
    alone_wall_s: float
    batch_cpu_s: float
    batch_wall_s: float
    load: float
    leader_mb: tuple[float, float]
    worker_mb: tuple[float, float]

    @property
    def share(self) -> float:
        """Share of ideal speed, of processor time."""
        return self.alone_cpu_s / self.batch_cpu_s

    @property
    def wall_share(self) -> float:
        """Share of ideal speed by the clock, which tells something on a quiet computer only."""
        return self.alone_wall_s / self.jobs / self.batch_wall_s

    def table(self) -> str:
        """The figures as a table of a page."""
        rows = [
            (
                f"reading and fitting a bag ({SECONDS:g} s of {JOINTS} joint at {RATE:g} Hz) in one process",
                f"{1e3 * self.alone_cpu_s:.0f} ms",
            ),
            (f"the same in a batch of {self.jobs} processes, all included", f"{1e3 * self.batch_cpu_s:.0f} ms"),
            ("overhead a bag", f"{1e3 * (self.batch_cpu_s - self.alone_cpu_s):.0f} ms"),
            ("**share of ideal speed, of processor time**", f"**{self.share:.2f}**"),
            ("share of ideal speed, by the clock", f"{self.wall_share:.2f}"),
            ("bags a minute, by the clock", f"{60.0 / self.batch_wall_s:.0f}"),
            ("mean load of the computer meanwhile (processes that want a core)", f"{self.load:.1f}"),
            ("memory of the process that leads, at begin and end", "{:.0f} -> {:.0f} MB".format(*self.leader_mb)),
            ("memory of a process that works, at begin and end", "{:.0f} -> {:.0f} MB".format(*self.worker_mb)),
        ]
        lines = [f"| {self.bags} bags | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows)]
        return "\n".join(lines)


def write_bags(folder: Path, count: int) -> None:
    """Simulate some bags, and copy them until there are enough."""
    model = build_model(MODEL)
    for k in range(count):
        bag = folder / f"bag_{k:05}"
        if k < DIFFERENT:
            seeds = range(k * JOINTS, (k + 1) * JOINTS)
            formats.write_bag(
                bag, {f"joint_{s % JOINTS}": simulate_motion(model, SECONDS, RATE, seed=s) for s in seeds}
            )
        else:
            shutil.copytree(folder / f"bag_{k % DIFFERENT:05}", bag)


def alone(folder: Path, count: int) -> tuple[float, float]:
    """Processor time and wall time of one bag in this process, in s."""
    job = FitJob((), None, {}, None, None, {"model": MODEL}, ParameterSettings(), build("innovations"))
    work, found = Work(job, "{}"), find([str(folder)])
    for one in found[:WARM_UP]:
        work.rows(one)
    begun, cpu = time.perf_counter(), time.process_time()
    for one in found[:count]:
        assert {row["status"] for row in work.rows(one)} <= {"converged", "poor_fit"}
    return (time.process_time() - cpu) / count, (time.perf_counter() - begun) / count


class Memory(threading.Thread):
    """Looks at a process and its children until it is stopped: resident memory in MB."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self._pid, self._ended = pid, threading.Event()
        self.leader: list[float] = []
        self.workers: list[float] = []
        self.load: list[float] = []

    def run(self) -> None:
        """Look, and wait."""
        while not self._ended.wait(PACE_S):
            try:
                children = Path(f"/proc/{self._pid}/task/{self._pid}/children").read_text().split()
                leader, workers = _resident(self._pid), [_resident(int(child)) for child in children]
            except OSError:
                continue  # one has just ended
            self.load.append(os.getloadavg()[0])
            if workers:
                self.leader.append(leader)
                self.workers.append(max(workers))

    def stop(self) -> None:
        """End it."""
        self._ended.set()
        self.join()


def _resident(pid: int) -> float:
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    return float(status.get("VmRSS", "0 kB").split()[0]) / 1024.0


def _ends(values: Sequence[float]) -> tuple[float, float]:
    """Median memory after the start (a part of the time in), and at the end."""
    part = max(1, round(PART * len(values)))
    return float(np.median(values[part : 2 * part])), float(np.median(values[-part:]))


def measure(folder: Path, bags: int, jobs: int, sample: int) -> Figures:
    """Write the bags, and fit them alone and in a batch."""
    logs, output = folder / "logs", folder / "results.parquet"
    write_bags(logs, bags)
    cpu, wall = alone(logs, min(sample, bags))
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *COMMAND, str(logs), "-o", str(output), "--jobs", str(jobs)], stdout=subprocess.PIPE, text=True
    )
    memory = Memory(process.pid)
    memory.start()
    assert process.stdout is not None
    told = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    lasted = time.perf_counter() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    memory.stop()
    rows = json.loads(told)["rows"]
    assert process.returncode == 0 and sum(rows.values()) == bags * JOINTS, (process.returncode, rows)
    return Figures(
        bags, jobs, cpu, wall, (used.ru_utime + used.ru_stime) / bags, lasted / bags,
        float(np.mean(memory.load)), _ends(memory.leader), _ends(memory.workers),
    )  # fmt: skip


def main() -> None:
    """Measure, print, and on demand write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--bags", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--sample", type=int, default=100, help="bags that are fitted in one process")
    parser.add_argument("--json", type=Path, help="also write the figures there")
    parser.add_argument("--docs", action="store_true", help="write the table of docs/benchmarks.md")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="joint_id_batch_") as folder:
        figures = measure(Path(folder), chosen.bags, chosen.jobs, chosen.sample)
    print(figures.table())
    if chosen.json:
        chosen.json.parent.mkdir(parents=True, exist_ok=True)
        chosen.json.write_text(json.dumps(asdict(figures), indent=1))
    if chosen.docs:
        write("benchmarks.md", {"batch": figures.table()})


if __name__ == "__main__":
    main()
