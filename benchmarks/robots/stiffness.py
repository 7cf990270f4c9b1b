"""Stiffness of the axes of a KUKA KR300 with two encoders an axis, by `motor_side`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from joint_id_core.estimators import Estimator, Innovations, ParameterSettings, Regression, fit
from joint_id_core.models import build
from robots.cases import Known
from robots.fitted import Value
from robots.judging import deviation
from robots.methods import INNOVATIONS, REGRESSION
from robots.recordings import DATA, kuka

FOLDER = "kuka_kr300"
AXES, RUNS = (1, 2, 3), ("A", "B")
SHOWN = ("k_1", "J_m")
# Published; the stiffness of axis 1 cannot be identified from these runs.
MOTOR_INERTIA = 0.0118
PUBLISHED = {
    1: {"J_m": Known(MOTOR_INERTIA)},
    2: {"k_1": Known(7.519e6), "J_m": Known(MOTOR_INERTIA)},
    3: {"k_1": Known(4.100e6), "J_m": Known(MOTOR_INERTIA)},
}
# The command of docs/real_robots.md holds the motor inertia at its published value, and takes the spring for linear.
ALL_FREE, DOCUMENTED = "`--delays`", "and `--fix J_m=0.0118 --fix k_2=0`"
SETTINGS: Mapping[str, ParameterSettings] = {
    ALL_FREE: ParameterSettings(),
    DOCUMENTED: ParameterSettings({"J_m": MOTOR_INERTIA, "k_2": 0.0}, ("J_m", "k_2")),
}
ESTIMATORS: Mapping[str, Estimator] = {INNOVATIONS: Innovations(), REGRESSION: Regression()}
BOTH = "A and B"


@dataclass(frozen=True)
class Stiffness:
    """A fit: `settings` and `method` name how, `run` is A, B or both; `values` are k_1 and J_m, if it is not held."""

    settings: str
    method: str
    axis: int
    run: str
    status: str
    message: str
    cpu_s: float
    values: dict[str, Value] = field(default_factory=dict)

    @property
    def called_good(self) -> list[tuple[str, float]]:
        """Names of values that are called good and have a reference, and how far they are off, over their sigma."""
        if self.status != "converged":
            return []
        known = {n: k for n, k in PUBLISHED[self.axis].items() if n in self.values}
        return [(n, deviation(self.values[n], k)) for n, k in known.items() if self.values[n].verdict == "estimated"]


def there() -> bool:
    """Whether the data are there."""
    return (DATA / FOLDER).is_dir()


def fits() -> Iterator[Stiffness]:
    """All fits; the first one of each method is made twice, because it compiles the model or loads libraries."""
    model = build("motor_side", delays=True)
    for method, estimator in ESTIMATORS.items():
        for name, settings in SETTINGS.items():
            for axis in AXES:
                runs = [kuka(run, axis) for run in RUNS]
                known = settings.with_values({"N": runs[0][0]})
                if (name, axis) == (ALL_FREE, AXES[0]):
                    fit(model, runs[0][1], known, estimator)
                for run, recordings in zip(
                    (*RUNS, BOTH), ([runs[0][1]], [runs[1][1]], [r for _, r in runs]), strict=True
                ):
                    begun = time.process_time()
                    found = fit(model, recordings, known, estimator)
                    rows = {n: found[n] for n in SHOWN if n in found.free}
                    values = {n: Value(p.value, p.std_dev, p.verdict.value) for n, p in rows.items()}
                    status, cpu_s = found.status.value, time.process_time() - begun
                    yield Stiffness(name, method, axis, run, status, found.message, cpu_s, values)
