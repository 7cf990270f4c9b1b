"""Start values for a search, from a regression, for joints that are far from the model's table.

The table is that of a small cobot. On an industrial robot stiffness, inertia and gravity are three decades larger, on a
servo of a gripper inertia and friction four decades smaller, beyond what the priors allow; a regression finds them
without any start.
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
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.models.harmonic_drive import HarmonicDrive

if TYPE_CHECKING:
    from joint_id_core.estimators.regression.fitted import Fitted

WEAK = 10.0  # times the largest torque of the drive: no constant torque that it balances is larger, nor part of one
USUAL = 4.0  # factor between two drives of joints of which one start is good for both
COARSE_S = 0.02  # between two samples whose difference is a velocity
SIZED = ("kg m^2", "Nm", "Nm s/rad", "Nm/rad", "Nm/rad^3")  # units of what is larger in a larger joint
CERTAIN = 2.0  # largest standard deviation over the value: the order of magnitude is enough


def started(model: Model, recording: Recording, settings: ParameterSettings | None) -> ParameterSettings:
    """Return settings with start values of a regression for parameters that it finds far from the model's table.

    That is by more than the spread of their prior. Other parameters of the same group get the same factor. Gravity and
    offset of a torque that one prior does not allow get priors as wide as the largest of them, so that they can balance
    each other, and narrower ones where the drive is weak: beside them, rounding would hide what the data tell. Of a
    transmission, such an offset becomes one of the encoders. What the user has set stays.
    """
    settings = settings or ParameterSettings()
    fitted = _own_equations(model, recording, settings)
    if fitted is None:
        return _sized(model, recording, settings)
    if any(f.fault or f.blind for f in fitted):
        return settings
    found = _certain(fitted)
    start, free = settings.applied_to(model)
    table = dict(zip(model.parameter_names, start.tolist(), strict=True))
    own = set(settings.names)
    far = {n: v for n, v in found.items() if n not in own and model.parameter(n).positive and _far(model, n, v, table)}
    for name, value in list(far.items()):
        group = model.parameter(name).group
        for other in (q.name for q in model.parameters if q.group == group != "" and q.name in free):
            if other not in own and other not in found:
                far.setdefault(other, table[other] * value / table[name])
    if far:
        far |= _offset(model, found, table, settings)
    torques = [f.samples.y for f in fitted if f.samples.equation.quantity == "torque"]
    drive = max((float(abs(y).max()) for y in torques), default=0.0)
    return _with_torques(settings.with_values(far), model, {n: v for n, v in found.items() if n not in own}, drive)


def _with_torques(
    settings: ParameterSettings, model: Model, found: Mapping[str, float], drive: float
) -> ParameterSettings:  # fmt: skip
    """Return settings with start values and priors of signed torques, if those of the table suit no such joint.

    `drive` is the largest torque of the drive in Nm, on the side of the joint that the model describes.
    """
    signed = [q for q in model.parameters if q.unit == "Nm" and not q.positive and q.name not in settings.names]
    signed = [q for q in signed if q.name in settings.applied_to(model)[1]]
    if model.twist_offset is not None:  # there a torque offset becomes one of the encoders
        signed, drive = [q for q in signed if not q.of_recording], math.inf
    largest = max((abs(found[q.name]) for q in signed if q.name in found), default=0.0)
    priors = {q.name: largest for q in signed if q.spread < largest}
    priors |= {q.name: WEAK * drive for q in signed if 0.0 < WEAK * drive < q.spread}
    return replace(
        settings,
        values={**settings.values, **{n: found[n] for n in priors if n in found}},
        priors={**settings.priors, **priors},
    )


def _own_equations(model: Model, recording: Recording, settings: ParameterSettings) -> list[Fitted] | None:
    """Return a regression of the model; None if it does not suit the model or the recording."""
    from joint_id_core.estimators.opinion import suits

    if not suits(model):
        return None
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    try:
        return regressed(model, recording, settings, Regression())
    except JointIdError:
        return None


def _certain(fitted: Sequence[Fitted]) -> dict[str, float]:
    """Return the values whose order of magnitude is known."""
    return {
        n: value
        for f in fitted
        for n, value, sigma in zip(f.names, f.solution.values.tolist(), f.solution.sigma.tolist(), strict=True)
        if sigma < CERTAIN * abs(value)
    }


def _sized(model: Model, recording: Recording, settings: ParameterSettings) -> ParameterSettings:
    """Return settings with start values of a flexible joint that is as large as a rigid one with this drive and motion.

    All torques of friction get one factor, all others (inertia, gear) another.
    """
    if model.stiffness is None or model.torque_drive is None:
        return settings
    from joint_id_core.estimators.regression.as_rigid import regressed_as_rigid  # loads SciPy

    start, free = settings.applied_to(model)
    table = {q.name: q.nominal for q in HarmonicDrive().parameters}
    table |= dict(zip(model.parameter_names, start.tolist(), strict=True))
    N = table["N"]
    if _as_usual(recording, model, table):
        return settings
    try:
        rigid = regressed_as_rigid(recording, {"N": N, "k_t": table.get("k_t", 1.0)})
    except JointIdError:
        return settings
    if rigid is None or any(f.fault for f in rigid.fitted):
        return settings
    found, at_link = _certain(rigid.fitted), 1.0 if rigid.side == "link" else 1.0 / N
    inertia = (N**2 * table["J_m"] + table["J_q"]) * at_link**2
    friction = (N * table["tau_fm"] + table["tau_fq"]) * at_link
    if found.get("J", 0.0) <= 0.0:
        return settings
    factor = found["J"] / inertia
    of_friction = found["tau_f"] / friction if found.get("tau_f", 0.0) > 0.0 else factor
    own, sized = set(settings.names), {}
    for q in model.parameters:
        if q.name in free and q.name not in own and q.positive and q.unit in SIZED:
            value = table[q.name] * (of_friction if q.group == "friction" else factor)
            if _far(model, q.name, value, table):
                sized[q.name] = value
    usual = abs(math.log(factor)) < math.log(10.0)
    signed = [q for q in model.parameters if q.unit == "Nm" and not q.positive and q.name in free and q.name not in own]
    priors = {} if usual else {q.name: factor * q.spread for q in signed}
    return replace(settings.with_values(sized), priors={**settings.priors, **priors})


def _as_usual(recording: Recording, model: Model, table: Mapping[str, float]) -> bool:
    """Return whether the drive is about as large as a rigid joint of the table needs for this motion.

    That takes a hundredth of the time of a regression.
    """
    name = next((n for n in MOTION if recording.measured(n)), None)
    if name is None or model.torque_drive is None or not recording.measured(model.torque_drive):
        return False
    N, step = table["N"], max(1, round(COARSE_S / recording.period))  # differences over less time are noise
    time, motion = recording.time[::step], recording[name][::step] / (N if name.startswith("motor") else 1.0)
    if len(time) < MIN_SAMPLES:
        return False
    velocity = np.gradient(motion, time) if name.endswith("position") else motion
    inertia, friction = N**2 * table["J_m"] + table["J_q"], N * table["tau_fm"] + table["tau_fq"]
    needed = inertia * np.gradient(velocity, time) + friction * np.sign(velocity)
    drive = N * model.torque_constant(table) * recording[model.torque_drive]
    with np.errstate(all="ignore"):
        ratio = np.sqrt(np.nanmean(drive**2) / np.nanmean(needed**2))
    return bool(1.0 / USUAL < ratio < USUAL)


def _far(model: Model, name: str, value: float, table: Mapping[str, float]) -> bool:
    return value > 0.0 and abs(math.log(value / table[name])) > model.parameter(name).spread


def _offset(
    model: Model, found: Mapping[str, float], table: Mapping[str, float], settings: ParameterSettings
) -> dict[str, float]:  # fmt: skip
    """Return the twist offset that stands for the torque offset, if that is beyond its prior and none is set."""
    torque, twist, stiffness = "tau_0", model.twist_offset, model.stiffness
    if twist is None or not {torque, stiffness} <= set(found) or {torque, twist} & set(settings.names):
        return {}
    if abs(found[torque]) < model.parameter(torque).spread:
        return {}
    return {twist: -found[torque] * model.gear_ratio(table) / found[stiffness or ""]}
