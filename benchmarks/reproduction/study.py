"""All rows of the study: every method on every condition of the paper's tables, from several random starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from engine.timing import alone

from joint_id_core import estimators
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate
from reproduction import cases, deep, ekf, engine, hpinn, nlgr
from reproduction.cases import Case
from reproduction.runs import Run, mse

Tell = Callable[[str], None]
NEAR_STARTS = "H-PINN, near starts"


@dataclass(frozen=True)
class Size:
    """How much is run.

    Starts of the fast methods and of the slow ones, iterations of DeepXDE, limit of NLGR in s, whether epochs of eager
    torch are timed, length of the measured log in s.
    """

    starts: int
    slow_starts: int
    iterations: int
    limit_s: float
    eager: bool
    log_s: float


FULL = Size(10, 3, 30000, 300.0, True, np.inf)
QUICK = Size(1, 1, 200, 1.0, False, 10.0)


@dataclass(frozen=True)
class Row:
    """One method under one condition.

    Attributes:
        method, labels, samples, epochs: what was run; epochs 0 where there are none.
        case: on what.
        runs: from each start; empty where the method is not there, with `note` saying why.
        errors: mean square errors of the states.
    """

    method: str
    labels: str
    samples: int
    epochs: int
    case: Case
    runs: tuple[Run, ...]
    errors: tuple[float, ...]
    note: str = ""

    @property
    def time_s(self) -> float:
        """Median time of a run."""
        return float(np.median([r.seconds for r in self.runs])) if self.runs else float("nan")

    @property
    def mse(self) -> float:
        """Median mean square error."""
        return float(np.median(self.errors)) if self.errors else float("nan")

    def error(self, name: str) -> float:
        """Median error of a parameter over the starts."""
        return float(np.median([r.errors(self.case)[name] for r in self.runs])) if self.runs else float("nan")

    def best(self) -> Run:
        """The run of lowest mean square error."""
        return self.runs[int(np.argmin(self.errors))]


def row(
    tell: Tell, method: str, labels: str, case: Case, fit: Callable[[Case, int], Run], starts: int, epochs: int = 0
) -> Row:
    """Run a method from `starts` starts."""
    samples = len(case.recording)
    try:
        runs = tuple(fit(case, seed) for seed in range(starts))
    except ImportError as error:
        tell(f"{case.name}, {method}: left out ({error})")
        return Row(method, labels, samples, epochs, case, (), (), f"not installed: {error.name}")
    errors = tuple(mse(case, run.values) for run in runs)
    found = Row(method, labels, samples, epochs, case, runs, errors)
    tell(f"{case.name}, {method}, {labels} labels, {samples} samples: {found.time_s:.3g} s, MSE {found.mse:.3g}")
    return found


def _deepxde(case: Case, seed: int, iterations: int) -> Run:
    return alone(deep.fit, case, seed, iterations)  # it changes the default precision of its process


# A method's name, what fits with it, from how many starts, for how many epochs.
Task = tuple[str, Callable[[Case, int], Run], int, int]


def _common(size: Size, epochs: int) -> list[Task]:
    """The methods of both step responses."""
    return [
        ("innovations", engine.fit, size.starts, 0),
        ("EKF", ekf.fit, size.starts, 0),
        ("H-PINN", partial(hpinn.fit, epochs=epochs), size.starts, epochs),
        (NEAR_STARTS, partial(hpinn.fit, epochs=epochs, substeps=2, factor=cases.NEAR), size.starts, epochs),
        ("NLGR, tanh", partial(nlgr.fit, smooth=True, limit_s=size.limit_s), size.slow_starts, 0),
    ]


def _rows(tell: Tell, conditions: Sequence[tuple[str, Case]], tasks: Sequence[Task]) -> list[Row]:
    return [
        row(tell, method, labels, case, fit, starts, epochs)
        for labels, case in conditions
        for method, fit, starts, epochs in tasks
    ]


def table_2(size: Size, tell: Tell) -> list[Row]:
    """Model 1 (the first row of each method is also Table I and Fig. 6)."""
    whole = cases.model_1()
    conditions = (
        ("2", whole),
        ("2", whole.only(whole.labels, samples=500)),
        ("1", whole.only(("motor_velocity",), samples=500)),
    )
    of_the_motor: list[Task] = [
        ("NLGR, sign", partial(nlgr.fit, smooth=False, limit_s=size.limit_s), 1, 0),
        ("DeepXDE", partial(_deepxde, iterations=size.iterations), 1, size.iterations),
    ]
    return _rows(tell, conditions, [*_common(size, 350), *of_the_motor])


def table_4(size: Size, tell: Tell) -> list[Row]:
    """Model 3 (the rows with the torsion are also Table III and Fig. 7)."""
    whole = cases.model_3()
    without = tuple(n for n in whole.labels if n != "link_velocity")
    conditions = (("4", whole.only(without)), ("5", whole.only(whole.labels)), ("5 + torsion", whole))
    return _rows(tell, conditions, _common(size, 300))


def table_5(size: Size, tell: Tell) -> list[Row]:
    """Model 2 on a simulated UR3e."""
    case = cases.model_2()
    tasks = (
        ("innovations", engine.fit, size.starts, 0),
        ("EKF", ekf.fit, size.starts, 0),
        ("H-PINN", partial(hpinn.fit, epochs=1000, substeps=2), size.starts, 1000),
        ("NLGR, tanh", partial(nlgr.fit, smooth=True, limit_s=size.limit_s), 1, 0),
    )
    return [row(tell, method, "4", case, fit, starts, epochs) for method, fit, starts, epochs in tasks]


def stiff(size: Size, tell: Tell) -> list[Row]:
    """The stiff case of the paper's conclusion: Model 3 with a tenth of the inductance, both cells."""
    case = cases.stiff()
    cells = {"RK4 cell, one step": "rk4", "implicit cell, one step": "implicit"}
    return [
        row(tell, method, "5", case, partial(engine.fit, cell=cell, substeps=1), size.starts)
        for method, cell in cells.items()
    ]


def eager_epochs(tell: Tell) -> dict[str, float]:
    """Seconds of an epoch of Model 3 in eager torch, and of the same through the compiled cell."""
    case = cases.model_3()
    eager = hpinn.eager_epoch_s(case, 0)
    compiled = hpinn.fit(case, 0, 100).seconds / 100
    tell(f"an epoch of Model 3: eager torch {eager:.3g} s, compiled cell {compiled:.3g} s")
    return {"eager": eager, "compiled": compiled}


def shown(case: Case) -> dict[str, float]:
    """Relative standard deviation of each parameter at the noise of good sensors: what such a record can show.

    The engine's own, from the truth; at the truth it is the Cramer-Rao bound to first order.
    """
    measured = cases.noisy(case)
    found = engine.fit(measured, 0)
    return {name: found.sigmas[name] / case.truth[name] for name in case.free}


def log(folder: Path, length_s: float, tell: Tell) -> list[Estimate]:
    """Model 2, and its motor side alone, on the shoulder of a public UR3e log; empty where it is not there.

    Of the log only the first `length_s` are taken.
    """
    recording = cases.ur3e_log(folder)
    if recording is None:
        tell(f"no UR3e log in {folder}")
        return []
    recording = recording.window(-np.inf, float(recording.time[0]) + length_s)
    models = build("harmonic_drive", actuation="current", gravity=True), build("motor_side", actuation="current")
    found = [estimators.fit(model, recording, ParameterSettings({"k_t": 0.1})) for model in models]
    for estimate in found:
        tell(f"UR3e log, {estimate.model}: {estimate.status.value}: {estimate.message[:120]}")
    return found
