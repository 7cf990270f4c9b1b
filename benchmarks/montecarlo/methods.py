"""The paper's two estimators beside ours, on the same noisy data and from the same starts.

Both simulate the whole record from its start and take the measured torque for exact. NLGR is the paper's comparison,
MATLAB's `nlgreyest`; `peers.scipy_least_squares` does the same with SciPy.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from peers import scipy_least_squares
from peers.model2 import FREE, Data, unknowns
from simulated import MODEL_2, SENSORS, motion, start

from joint_id_core import estimators
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from montecarlo.cases import ALL_2, Case
from montecarlo.draws import Draw, of, recorded

NEAR = 1.2  # how far off start values are at most: H-PINN needs starts within some tens of percent
LIMIT_S = 240.0  # of processor time, of NLGR


def estimator(name: str, case: Case, factor: float, cache: Path, seed: int) -> Draw:
    """A fit by an estimator of the library, `name` as in `estimators.fit`."""
    recording, values = recorded(case, seed, cache), start(MODEL_2, seed, factor)
    begun = time.process_time()
    estimate = fit(MODEL_2, recording, ParameterSettings(values), estimator=estimators.build(name))
    return of(estimate, MODEL_2.values(), seed, time.process_time() - begun)


def nlgr(case: Case, factor: float, cache: Path, seed: int) -> Draw:
    """A fit by SciPy with the intervals that such a tool reports."""
    data = _data(recorded(case, seed, cache), motion(case.motion, seed, cache))
    with np.errstate(over="ignore", invalid="ignore"):  # a step that makes the simulation run away is refused
        found = scipy_least_squares.fit(data, start(MODEL_2, seed, factor), LIMIT_S)
    truth = MODEL_2.values()
    sigmas = deviations(data, found.values)
    status = "converged" if found.finished else "max_iterations"
    errors = {name: found.values[name] / truth[name] - 1.0 for name in FREE}
    relative = {name: sigma * found.values[name] / truth[name] for name, sigma in sigmas.items()}
    return Draw(seed, status, False, False, found.seconds, errors, relative)


def _data(recording: Recording, true: Recording) -> Data:
    still = {"external_torque": np.zeros(len(true))}
    return Data(recording.with_channels(still), np.array([SENSORS.noise[name] for name in ALL_2]), 0.0)


def deviations(data: Data, values: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of a fit of the simulation error that ended at `values`, relative to these.

    Residual variance times the inverse of J' J, as such tools report, with the start state among the unknowns. A fit
    returns its parameters alone, so the start state is found again, by Gauss-Newton with these held.
    """
    simulation = scipy_least_squares._Simulation(data, unknowns(values), np.inf)
    z = np.zeros(len(FREE) + len(ALL_2))
    for _ in range(2):
        J = simulation.jacobian(z)[:, len(FREE) :]
        z[len(FREE) :] -= np.linalg.lstsq(J, simulation.residuals(z), rcond=None)[0]
    J, r = simulation.jacobian(z), simulation.residuals(z)
    covariance = float(r @ r) / (len(r) - len(z)) * np.linalg.pinv(J.T @ J)
    return dict(zip(FREE, np.sqrt(np.diag(covariance)[: len(FREE)]).tolist(), strict=True))


# By name: a fit of a case from starts that are a factor off, and how many draws at most.
METHODS: dict[str, tuple[Callable[[Case, float, Path, int], Draw], int]] = {
    "innovations (ours)": (partial(estimator, "innovations"), 1000),
    "H-PINN": (partial(estimator, "hpinn"), 20),
    "NLGR (SciPy)": (nlgr, 2),
}
