"""How large a joint is against the model's table, where no regression of its own equations can tell.

All torques of friction get one factor, all others (inertia, gear) another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.checking.sides import MOTION
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.models.harmonic_drive import HarmonicDrive

if TYPE_CHECKING:
    from joint_id_core.estimators.regression.fitted import Fitted

USUAL = 4.0  # factor between two drives of joints of which one start is good for both
COARSE_S = 0.02  # between two samples whose difference is a velocity
APART = 1.5  # of these steps from which there is a gap between two samples
SIZED = ("kg m^2", "Nm", "Nm s/rad", "Nm/rad", "Nm/rad^3")  # units of what is larger in a larger joint
CERTAIN = 2.0  # largest standard deviation over the value: the order of magnitude is enough


def sized(model: Model, recording: Recording, settings: ParameterSettings) -> ParameterSettings:
    """Return settings with start values of a joint as large as a rigid one with this drive and motion.

    A flexible joint is sized by the regression of a rigid one. A rigid joint comes here if its motion is too short for
    a regression: then the rms torques decide. Other models, and joints as large as that of the table, stay.
    """
    if model.torque_drive is None:
        return settings
    start, _ = settings.applied_to(model)
    table = {q.name: q.nominal for q in HarmonicDrive().parameters}
    table |= dict(zip(model.parameter_names, start.tolist(), strict=True))
    ratio = _ratio(recording, model, table)
    if (ratio is None and model.stiffness is None) or (ratio is not None and 1.0 / USUAL < ratio < USUAL):
        return settings
    if model.stiffness is None:
        assert ratio is not None
        return _scaled(model, settings, table, ratio, ratio)
    found = _as_rigid(recording, table)
    return settings if found is None else _scaled(model, settings, table, *found)


def certain(fitted: Sequence[Fitted]) -> dict[str, float]:
    """Return the values whose order of magnitude is known."""
    return {
        n: value
        for f in fitted
        for n, value, sigma in zip(f.names, f.solution.values.tolist(), f.solution.sigma.tolist(), strict=True)
        if sigma < CERTAIN * abs(value)
    }


def far_from(model: Model, name: str, value: float, table: Mapping[str, float]) -> bool:
    """Return whether a positive value is further from that of a table than the spread of its prior."""
    return value > 0.0 and abs(math.log(value / table[name])) > model.parameter(name).spread


def _at_link(table: Mapping[str, float]) -> tuple[float, float]:
    """Return inertia and Coulomb friction of a table's joint if it were rigid, on the side of the link."""
    if "J" in table:
        return table["J"], table["tau_f"]
    return table["N"] ** 2 * table["J_m"] + table["J_q"], table["N"] * table["tau_fm"] + table["tau_fq"]


def _scaled(
    model: Model, settings: ParameterSettings, table: Mapping[str, float], factor: float, of_friction: float
) -> ParameterSettings:  # fmt: skip
    """Return settings with start values of a joint that is larger by these factors; what the user has set stays."""
    free, own, found = settings.applied_to(model)[1], set(settings.names), {}
    for q in model.parameters:
        if q.name in free and q.name not in own and q.positive and q.unit in SIZED:
            value = table[q.name] * (of_friction if q.group == "friction" else factor)
            if far_from(model, q.name, value, table):
                found[q.name] = value
    usual = abs(math.log(factor)) < math.log(10.0)
    signed = [q for q in model.parameters if q.unit == "Nm" and not q.positive and q.name in free and q.name not in own]
    priors = {} if usual else {q.name: factor * q.spread for q in signed}
    return replace(settings.with_values(found), priors={**settings.priors, **priors})


def _as_rigid(recording: Recording, table: Mapping[str, float]) -> tuple[float, float] | None:
    """Return the factors of inertia and friction of a regression of a rigid joint; None if it does not suit."""
    from joint_id_core.estimators.regression.as_rigid import regressed_as_rigid  # loads SciPy

    N = table["N"]
    try:
        rigid = regressed_as_rigid(recording, {"N": N, "k_t": table.get("k_t", 1.0)})
    except JointIdError:
        return None
    if rigid is None or any(f.fault for f in rigid.fitted):
        return None
    found, at_side = certain(rigid.fitted), 1.0 if rigid.side == "link" else 1.0 / N
    inertia, friction = _at_link(table)
    if found.get("J", 0.0) <= 0.0:
        return None
    factor = found["J"] / (inertia * at_side**2)
    return factor, found["tau_f"] / (friction * at_side) if found.get("tau_f", 0.0) > 0.0 else factor


def _ratio(recording: Recording, model: Model, table: Mapping[str, float]) -> float | None:
    """Return the rms drive over that of a rigid joint of the table in this motion; None if a signal is missing.

    That takes a hundredth of the time of a regression.
    """
    name = next((n for n in MOTION if recording.measured(n)), None)
    if name is None or model.torque_drive is None or not recording.measured(model.torque_drive):
        return None
    N, step = table["N"], max(1, round(COARSE_S / recording.period))  # differences over less time are noise
    time, motion = recording.time[::step], recording[name][::step] / (N if name.startswith("motor") else 1.0)
    if len(time) < MIN_SAMPLES:
        return None
    velocity = np.gradient(motion, time) if name.endswith("position") else motion
    inertia, friction = _at_link(table)
    needed = inertia * np.gradient(velocity, time) + friction * np.sign(velocity)
    drive = N * model.torque_constant(table) * recording[model.torque_drive][::step]
    known = np.ones(len(time), dtype=bool)  # a difference over a gap is no velocity, nor is the next one's
    for k in np.flatnonzero(np.diff(time) > APART * step * recording.period):
        known[max(0, k - 1) : k + 3] = False
    with np.errstate(all="ignore"):
        ratio = float(np.sqrt(np.nanmean(drive[known] ** 2) / np.nanmean(needed[known] ** 2))) if known.any() else 0.0
    return ratio if 0.0 < ratio < math.inf else None
