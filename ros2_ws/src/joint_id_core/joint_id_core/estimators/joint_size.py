"""How large a joint is against the model's table, where no regression of its own equations can tell.

Coulomb friction gets one factor, viscous friction another one, all others (inertia, gear) a third.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

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
    if _drive_of(model) is None:
        return settings
    start, _ = settings.applied_to(model)
    table = {q.name: q.nominal for q in (*HarmonicDrive().parameters, *model.parameters)}
    given = dict(zip(model.parameter_names, start.tolist(), strict=True))
    table |= {n: given[n] for n in ("N", "k_t") if n in given}
    ratio = _ratio(recording, model, table)
    if (ratio is None and model.stiffness is None) or (ratio is not None and 1.0 / USUAL < ratio < USUAL):
        return settings
    if model.stiffness is None:
        assert ratio is not None
        return _scaled(model, settings, table, _Factors(ratio, ratio, ratio))
    found = _as_rigid(recording, table)
    return settings if found is None else _scaled(model, settings, table, found)


def _drive_of(model: Model) -> str | None:
    """Return the channel whose torque moves the joint; behind a gear also the current of a voltage drive."""
    behind_gear = "current" if model.stiffness is not None and "current" in model.state_names else None
    return model.torque_drive or behind_gear


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


class _Factors(NamedTuple):
    """How many times larger than that of the table a joint is: its inertia, Coulomb and viscous friction."""

    inertia: float
    coulomb: float
    viscous: float


def _at_link(table: Mapping[str, float]) -> _Factors:
    """Return inertia and friction of a table's joint if it were rigid, on the side of the link, in SI units."""
    if "J" in table:
        return _Factors(table["J"], table["tau_f"], table["c"])
    N = table["N"]
    inertia, viscous = (N**2 * table[motor] + table[link] for motor, link in (("J_m", "J_q"), ("c_m", "c_q")))
    return _Factors(inertia, N * table["tau_fm"] + table["tau_fq"], viscous)


def _scaled(
    model: Model, settings: ParameterSettings, table: Mapping[str, float], by: _Factors
) -> ParameterSettings:  # fmt: skip
    """Return settings with start values of a joint that is larger by these factors; what the user has set stays."""
    free, own, found = settings.applied_to(model)[1], set(settings.names), {}
    gear = {q.name: q.nominal for q in HarmonicDrive().parameters if q.group == "gear"}
    for q in model.parameters:
        if q.name in free and q.name not in own and q.positive and q.unit in SIZED:
            of_friction = by.coulomb if q.unit == "Nm" else by.viscous
            # Table III has a cubic stiffness of a 2000th of that of Table V, which is from a real joint
            usual = gear.get(q.name, table[q.name]) if q.group == "gear" else table[q.name]
            value = usual * (of_friction if q.group == "friction" else by.inertia)
            if far_from(model, q.name, value, table):
                found[q.name] = value
    alike = abs(math.log(by.inertia)) < math.log(10.0)
    signed = [q for q in model.parameters if q.unit == "Nm" and not q.positive and q.name in free and q.name not in own]
    priors = {} if alike else {q.name: by.inertia * q.spread for q in signed}
    return replace(settings.with_values(found), priors={**settings.priors, **priors})


def _as_rigid(recording: Recording, table: Mapping[str, float]) -> _Factors | None:
    """Return the factors of a regression of a rigid joint; None if it does not suit."""
    from joint_id_core.estimators.regression.as_rigid import regressed_as_rigid  # loads SciPy

    N = table["N"]
    try:
        rigid = regressed_as_rigid(recording, {"N": N, "k_t": table.get("k_t", 1.0)})
    except JointIdError:
        return None
    if rigid is None or any(f.fault for f in rigid.fitted):
        return None
    found, at_side = certain(rigid.fitted), 1.0 if rigid.side == "link" else 1.0 / N
    usual = _at_link(table)
    if found.get("J", 0.0) <= 0.0:
        return None
    factor = found["J"] / (usual.inertia * at_side**2)
    coulomb = found["tau_f"] / (usual.coulomb * at_side) if found.get("tau_f", 0.0) > 0.0 else factor
    viscous = found["c"] / (usual.viscous * at_side**2) if found.get("c", 0.0) > 0.0 else coulomb
    return _Factors(factor, coulomb, viscous)


def _ratio(recording: Recording, model: Model, table: Mapping[str, float]) -> float | None:
    """Return the rms drive over that of a rigid joint of the table in this motion; None if a signal is missing.

    That takes a hundredth of the time of a regression.
    """
    name = next((n for n in MOTION if recording.measured(n)), None)
    channel = _drive_of(model)
    if name is None or channel is None or not recording.measured(channel) or len(recording) < MIN_SAMPLES:
        return None
    N, step = table["N"], max(1, round(COARSE_S / recording.period))  # differences over less time are noise
    time, motion = recording.time[::step], recording[name][::step] / (N if name.startswith("motor") else 1.0)
    if len(time) < MIN_SAMPLES:
        return None
    velocity = np.gradient(motion, time) if name.endswith("position") else motion
    usual = _at_link(table)
    needed = usual.inertia * np.gradient(velocity, time) + usual.coulomb * np.sign(velocity)
    drive = N * (table["k_t"] if channel == "current" else 1.0) * recording[channel][::step]
    known = np.ones(len(time), dtype=bool)  # a difference over a gap is no velocity, nor is the next one's
    for k in np.flatnonzero(np.diff(time) > APART * step * recording.period):
        known[max(0, k - 1) : k + 3] = False
    with np.errstate(all="ignore"):
        ratio = float(np.sqrt(np.nanmean(drive[known] ** 2) / np.nanmean(needed[known] ** 2))) if known.any() else 0.0
    return ratio if 0.0 < ratio < math.inf else None
