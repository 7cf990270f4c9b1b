"""Start values for a search, from a regression, for joints that are far from the model's table.

The table is that of a small cobot. On an industrial robot stiffness, inertia and gravity are three decades larger, on a
servo of a gripper inertia and friction four decades smaller, beyond what the priors allow; a regression finds them
without any start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.circuit_starts import with_circuit
from joint_id_core.estimators.joint_size import certain, far_from, sized
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model

if TYPE_CHECKING:
    from joint_id_core.estimators.regression.fitted import Fitted

WEAK = 10.0  # times the largest torque of the drive: no constant torque that it balances is larger, nor part of one


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
        return sized(model, recording, with_circuit(model, recording, settings))
    if any(f.fault or f.blind for f in fitted):
        return settings
    found = certain(fitted)
    start, free = settings.applied_to(model)
    table = dict(zip(model.parameter_names, start.tolist(), strict=True))
    own, of_circuit = set(settings.names), model.torque_drive is None
    far = {
        n: v
        for n, v in found.items()
        if n not in own and model.parameter(n).positive and (of_circuit or far_from(model, n, v, table))
    }
    for name, value in list(far.items()):
        group = model.parameter(name).group
        for other in (q.name for q in model.parameters if q.group == group != "" and q.name in free):
            if other not in own and other not in found:
                far.setdefault(other, table[other] * value / table[name])
    far = {n: v for n, v in far.items() if model.parameter(n).allows(v)}
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
    # over a small angle gravity and offset may be anything together: such values are no start
    limit = WEAK * drive or math.inf
    largest = min(limit, max((abs(found[q.name]) for q in signed if q.name in found), default=0.0))
    priors = {q.name: largest for q in signed if q.spread < largest}
    priors |= {q.name: limit for q in signed if limit < q.spread}
    starts = {n: v for n, v in found.items() if n in priors and abs(v) <= limit and model.parameter(n).allows(v)}
    return replace(
        settings,
        values={**settings.values, **starts},
        priors={**settings.priors, **priors},
    )


def _own_equations(model: Model, recording: Recording, settings: ParameterSettings) -> list[Fitted] | None:
    """Return a regression of the model; None if it does not suit the model or the recording."""
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    try:
        return regressed(model, recording, settings, Regression())
    except JointIdError:
        return None


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
