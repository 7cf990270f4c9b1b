"""From nothing to a first fit: import, first fit with kernels on disk, and compilation, each in a fresh process."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from simulated import ClosedLoop, Torque, motion

from engine.timing import Times
from joint_id_core.models import MODELS

FIRST_FIT_TARGET_S, COMPILE_TARGET_S = 3.0, 6.0
MOTION, SEED = ClosedLoop(torque=Torque(white=0.003)), 1000
IMPORT = "import joint_id_core"
FIRST_FIT = """
import sys, pathlib
sys.path.insert(0, {here!r})
from simulated import MODEL_2, SENSORS, motion
from joint_id_core.estimators import fit
from engine.start_up import MOTION, SEED
assert fit(MODEL_2, SENSORS.measure(motion(MOTION, SEED, pathlib.Path({cache!r})), SEED)).converged
"""
COMPILE = """from joint_id_core.cell.kernel import compile_model
from joint_id_core.models import build
compile_model(build({model!r}))"""


@dataclass(frozen=True)
class StartUp:
    """Median times of one thing from nothing, and what is asked for in s, of wall time on an idle core."""

    name: str
    times: Times
    target_s: float | None = None


def measure(cache: Path, rounds: int) -> list[StartUp]:
    """Measure; compilations once each, into an empty folder."""
    motion(MOTION, SEED, cache)
    first_fit = FIRST_FIT.format(here=str(Path(__file__).resolve().parent.parent), cache=str(cache))
    fresh(first_fit)  # compiles
    found = [
        StartUp("import joint_id_core", _median(IMPORT, rounds)),
        StartUp("import and first fit of Model 2, kernel on disk", _median(first_fit, rounds), FIRST_FIT_TARGET_S),
    ]
    for model in MODELS:
        with tempfile.TemporaryDirectory() as folder:
            times = fresh(COMPILE.format(model=model), {"JOINT_ID_CACHE_DIR": folder})
        found.append(StartUp(f"import and compilation of {model}", times, COMPILE_TARGET_S))
    return found


def fresh(code: str, environment: Mapping[str, str] | None = None) -> Times:
    """Time of Python code in a process of its own, start of the interpreter included.

    Raises:
        subprocess.CalledProcessError: the code failed.
    """
    before, begun = _children_s(), time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, **(environment or {})})
    return Times(time.perf_counter() - begun, _children_s() - before)


def _median(code: str, rounds: int) -> Times:
    return Times.median(fresh(code) for _ in range(rounds))


def _children_s() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


def table(rows: Sequence[StartUp]) -> str:
    """A row for each; targets are compared with processor time."""
    lines = ["start-up, in a fresh process on one core", f"{'':<49}{'processor':>11}{'wall':>9}"]
    for row in rows:
        verdict = ""
        if row.target_s is not None:
            verdict = f"   target {row.target_s:g} s: {'met' if row.times.cpu_s <= row.target_s else 'missed'}"
        lines.append(f"{row.name:<49}{row.times.cpu_s:>9.2f} s{row.times.wall_s:>7.2f} s{verdict}")
    return "\n".join(lines) + "\n"
