"""The generated kernels beside C++ written by hand: one rollout with the sensitivities of all parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine.timing import Times, in_turn
from engine.yardstick import Rollout, Yardstick
from joint_id_core.cell.kernel import Kernel, compile_model
from joint_id_core.cell.rollout import rollout_sensitivities
from joint_id_core.errors import JointIdError
from joint_id_core.models import build

TARGET = 1.5
AGREEMENT = 1e-10  # of the range of a state or of a sensitivity
ROUNDS = 30  # times those of slower calls
# Smoother friction than in a fit, which costs the same. With the fit's own, a step may jump over the whole change of
# friction, and the sensitivities then carry rounding of 1e-9.
SMOOTHING = {"harmonic_drive": {"w_sm": 1.0, "w_sq": 0.01}, "electromechanical": {"w_sm": 1.0}}  # rad/s


@dataclass(frozen=True)
class Case:
    """A rollout: `samples` of a model at `period_s`, `substeps` RK4 steps each, under a square wave of `drive`."""

    name: str
    model: str
    freed: tuple[str, ...]
    samples: int
    period_s: float
    substeps: int
    drive: float


CASES = (
    Case("Model 3, 500 samples of 1 ms, 10 parameters, 1 step", "electromechanical", ("c_b",), 500, 1e-3, 1, 12.0),
    Case("Model 3, 500 samples of 1 ms, 10 parameters, 4 steps", "electromechanical", ("c_b",), 500, 1e-3, 4, 12.0),
    Case("Model 2, 1000 samples of 2 ms, 9 parameters, 2 steps", "harmonic_drive", (), 1000, 2e-3, 2, 0.3),
)


@dataclass(frozen=True)
class KernelTimes:
    """Times of a case: C++, the generated kernel, and the function that calls it; and how far their results differ."""

    case: str
    cpp: Times
    kernel: Times
    rollout: Times
    difference: float

    @property
    def ratio(self) -> float:
        """Generated kernel to C++, processor time."""
        return self.kernel.cpu_s / self.cpp.cpu_s


@dataclass(frozen=True)
class Pair:
    """The same rollout twice, ours with its arguments, which end in X (T, n) and J (T, n, parameters)."""

    cpp: Rollout
    kernel: Kernel
    arguments: tuple[Any, ...]

    def difference(self) -> float:
        """Largest difference of a state or a sensitivity, over its own range, after both ran."""
        *_, X, J = self.arguments
        order = [self.kernel.sensitive.index(name) for name in self.cpp.names]
        worst = 0.0
        for ours, theirs in ((X, self.cpp.X), (J[:, :, order], self.cpp.J)):
            span = np.ptp(theirs, axis=0)
            worst = max(worst, float(np.max(np.max(np.abs(ours - theirs), axis=0) / np.where(span > 0.0, span, 1.0))))
        return worst


def pair(case: Case, yardstick: Yardstick) -> Pair:
    """Both rollouts of a case, compiled and not yet run."""
    model = build(case.model)
    kernel = compile_model(model, "tanh", case.freed)
    time = np.arange(case.samples) * case.period_s
    u = np.zeros((case.samples, len(model.inputs)))
    u[:, 0] = case.drive * np.sign(np.sin(20.0 * time) + 0.1)
    values = model.values(SMOOTHING[case.model])
    x0, p = np.zeros(len(model.states)), np.array([values[name] for name in model.parameter_names])
    cpp = yardstick.rollout(model, x0, u[:, 0], values, case.period_s, case.substeps)
    steps = np.full(case.samples, case.substeps, dtype=np.int64)
    J = np.empty((case.samples, len(x0), len(kernel.sensitive)))
    return Pair(cpp, kernel, (x0, time, u, p, steps, np.empty((case.samples, len(x0))), J))


def compared(case: Case, yardstick: Yardstick, rounds: int) -> KernelTimes:
    """Times of one case.

    Raises:
        JointIdError: the results differ by more than `AGREEMENT`.
    """
    both = pair(case, yardstick)
    kernel, (x0, time, u, p, steps, X, J) = both.kernel, both.arguments
    calls: dict[str, Callable[[], object]] = {
        "cpp": both.cpp,
        "kernel": lambda: kernel.sensitivities.rollout_sensitivities(x0, time, u, p, steps, X, J),
        "rollout": lambda: rollout_sensitivities(kernel, x0, time, u, p, case.substeps),
    }
    times = in_turn(calls, rounds)
    difference = both.difference()
    if not difference < AGREEMENT:
        raise JointIdError(f"{case.name}: generated kernel and kernel.cpp differ by {difference:.1e} of the range")
    return KernelTimes(case.name, difference=difference, **times)


def measure(cache: Path, rounds: int) -> list[KernelTimes]:
    """Measure all cases, `ROUNDS` times `rounds` each; nothing is read from `cache`."""
    yardstick = Yardstick()
    return [compared(case, yardstick, ROUNDS * rounds) for case in CASES]


def table(rows: Sequence[KernelTimes]) -> str:
    """Processor times, and the ratios to C++."""
    lines = [
        "rollout with all sensitivities, processor time",
        f"{'':<58}{'C++':>10}{'kernel':>10}{'rollout':>10}{'kernel/C++':>12}{'wall':>7}{'difference':>12}",
    ]
    for row in rows:
        times = "".join(f"{1e3 * t.cpu_s:>7.3f} ms" for t in (row.cpp, row.kernel, row.rollout))
        wall = row.kernel.wall_s / row.cpp.wall_s
        lines.append(f"{row.case:<58}{times}{row.ratio:>12.2f}{wall:>7.2f}{row.difference:>12.0e}")
    worst = max(row.ratio for row in rows)
    lines.append(
        f"target: kernel/C++ at most {TARGET}: {'met' if worst <= TARGET else 'missed'} ({worst:.2f} at worst)"
    )
    return "\n".join(lines) + "\n"
