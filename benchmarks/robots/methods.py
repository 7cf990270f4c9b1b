"""Fits of rigid joints by each method, each predicted on the other recordings of the joint."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core import estimators
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Estimator, Innovations, ParameterSettings, Regression
from joint_id_core.estimators.matched_load import MatchedLoad
from joint_id_core.models import Model, build
from robots.cases import Case, Joint
from robots.fitted import FRICTION, Fitted, Value
from robots.held_out import r_squared_in_motion
from robots.plain import plain_least_squares

INNOVATIONS, REGRESSION, PLAIN = "innovations", "regression", "plain IDIM-LS"
METHODS = (INNOVATIONS, REGRESSION, PLAIN)
SHOWN = ("J", *FRICTION)
ESTIMATORS: Mapping[str, Estimator] = {INNOVATIONS: Innovations(), REGRESSION: Regression()}


def fits(case: Case, methods: Sequence[str] = METHODS) -> Iterator[Fitted]:
    """All fits of a case."""
    for joint in case.joints:
        model = build("rigid_joint", gravity=joint.gravity)
        recordings = joint.fitted()
        others = joint.only_predicted()
        for method in methods:
            _fit(method, model, joint, recordings[0])  # compiles and loads what the others find there
            for k, recording in enumerate(recordings):
                fit, values = _fit(method, model, joint, recording)
                rest = [*recordings[:k], *recordings[k + 1 :], *others] if fit.usable else []
                load = MatchedLoad(model, [recording] if method != PLAIN else [], None)
                held_out = tuple(r_squared_in_motion(model, values, load.of(other)) for other in rest)
                name = f"{recording.source}, part {k + 1}" if case.alone and len(recordings) > 1 else recording.source
                yield replace(fit, case=case.name, recording=name, held_out=held_out)


def _fit(method: str, model: Model, joint: Joint, recording: Recording) -> tuple[Fitted, dict[str, float]]:
    """A fit by a method, and the values of all parameters of the model."""
    begun = time.process_time()
    if method == PLAIN:
        found, sigma = plain_least_squares(recording, joint.gravity)
        cpu_s = time.process_time() - begun
        shown = {n: Value(found[n], sigma[n]) for n in SHOWN}
        return Fitted("", joint.name, "", method, "converged", "", cpu_s, shown), {**model.values({}), **found}
    estimate = estimators.fit(model, recording, ParameterSettings(), ESTIMATORS[method])
    cpu_s = time.process_time() - begun
    rows = {n: estimate[n] for n in SHOWN if np.isfinite(estimate[n].std_dev)}
    shown = {n: Value(p.value, p.std_dev, p.verdict.value) for n, p in rows.items()}
    status, message = estimate.status.value, estimate.message
    return Fitted("", joint.name, "", method, status, message, cpu_s, shown), estimate.values
