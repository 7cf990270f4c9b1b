"""Our engine on a case."""

from __future__ import annotations

import time

from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators import fit as fit_recording
from joint_id_core.estimators.innovations.estimator import Innovations
from reproduction.cases import Case
from reproduction.runs import Run


def fit(case: Case, seed: int, cell: str = "rk4", substeps: int = 0) -> Run:
    """The default estimator; friction is smoothed as the case says. Data without noise leave residuals of rounding."""
    held = {name: value for name, value in case.truth.items() if case.model.parameter(name).fixed}
    start = {**held, **case.start(seed), **(case.smoothing or {})}
    if not case.smoothing:  # the estimator chooses it
        start = {name: value for name, value in start.items() if name not in case.model.smoothing.values()}
    options = Innovations(cell=cell, substeps=substeps)
    fit_recording(
        case.model, case.measured.slice(0, 60), ParameterSettings(start, freed=case.freed), estimator=options
    )  # compiles
    begun = time.process_time()
    found = fit_recording(case.model, case.measured, ParameterSettings(start, freed=case.freed), estimator=options)
    seconds = time.process_time() - begun
    sigmas = {n: found[n].std_dev for n in found.free}
    return Run({**case.truth, **found.values}, seconds, found.status.value, sigmas)
