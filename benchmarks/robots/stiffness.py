"""Stiffness of the axes of a KUKA KR300 with two encoders an axis, by `motor_side`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from robots.cases import Known
from robots.fitted import Value
from robots.judging import deviation
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
# Those of the model are of a cobot, three decades below. Only a combination of tau_0 and dtheta_0 is known.
STARTS = {"k_1": 5e6, "c_1": 5e3, "c_m": 0.01, "tau_fm": 1.0, "J_m": MOTOR_INERTIA, "k_2": 0.0, "tau_0": 0.0}
SETTINGS: Mapping[str, ParameterSettings] = {
    "`--delays`": ParameterSettings(),
    "and start values": ParameterSettings(STARTS, ("k_2", "tau_0"), ("dtheta_0",)),
    "and `J_m` held": ParameterSettings(STARTS, ("k_2", "tau_0", "J_m"), ("dtheta_0",)),
}


@dataclass(frozen=True)
class Stiffness:
    """A fit: `settings` names how, `values` are k_1 and J_m (J_m only where it is not held)."""

    settings: str
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
    """All fits; the first one is made twice, because it compiles the model."""
    model = build("motor_side", delays=True)
    for name, settings in SETTINGS.items():
        for axis in AXES:
            for run in RUNS:
                ratio, recording = kuka(run, axis)
                known = settings.with_values({"N": ratio})
                if (axis, run) == (AXES[0], RUNS[0]):
                    fit(model, recording, known)
                begun = time.process_time()
                found = fit(model, recording, known)
                result = Stiffness(name, axis, run, found.status.value, found.message, time.process_time() - begun)
                rows = {n: found[n] for n in SHOWN if n in found.free}
                values = {n: Value(p.value, p.std_dev, p.verdict.value) for n, p in rows.items()}
                yield replace(result, values=values)
