"""What every method returns, and the error that all of them are judged by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.simulation.simulator import simulate
from reproduction.cases import Case


@dataclass(frozen=True)
class Run:
    """One method from one start.

    Attributes:
        values: of all parameters.
        seconds: processor time, compilation not included.
        ended: in words.
        sigmas: standard deviations that the method reports, by parameter.
        loss: of each epoch, for methods that train.
    """

    values: Mapping[str, float]
    seconds: float
    ended: str
    sigmas: Mapping[str, float] = field(default_factory=dict)
    loss: tuple[float, ...] = ()

    def errors(self, case: Case) -> dict[str, float]:
        """|estimate - truth| / truth of the free parameters, as the paper's e."""
        return {n: abs(self.values[n] / case.truth[n] - 1.0) for n in case.free}


def predicted(case: Case, values: Mapping[str, float]) -> Array:
    """All states as simulated with `values` from the true start, shape (T, n); exact stick and slip."""
    source = case.true or case.recording
    inputs = {n: case.recording[n] for n in case.model.input_names if n in case.recording}
    x0 = {n: float(source[n][0]) for n in case.model.state_names}
    try:
        found = simulate(case.model, case.recording.time, inputs, dict(values), x0=x0)
    except JointIdError:  # values that no simulation stands
        return np.full_like(case.states, np.nan)
    return np.column_stack([found[n] for n in case.model.state_names])


def mse(case: Case, values: Mapping[str, float]) -> float:
    """Mean square error of all states and samples in SI units, as the paper's MSE; inf where nothing is simulated."""
    square = float(np.mean((predicted(case, values) - case.states) ** 2))
    return square if np.isfinite(square) else float("inf")
