"""Start values for a search, from a regression, for joints that are far from the model's table.

The table is that of a small cobot. On an industrial robot stiffness and inertia are three decades larger, beyond what
the priors allow; a regression finds them without any start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model

CERTAIN = 2.0  # largest standard deviation over the value: the order of magnitude is enough


def started(model: Model, recording: Recording, settings: ParameterSettings | None) -> ParameterSettings:
    """Return settings with start values of a regression for parameters that it finds far from the model's table.

    That is by more than the spread of their prior. Other parameters of the same group get the same factor. An offset of
    the torque that its prior does not allow becomes one of the encoders. What the user has set stays.
    """
    from joint_id_core.estimators.opinion import suits

    settings = settings or ParameterSettings()
    if model.twist_offset is None or not suits(model):
        return settings
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    try:
        fitted = regressed(model, recording, settings, Regression())
    except JointIdError:
        return settings
    if any(f.fault or f.blind for f in fitted):
        return settings
    found = {
        n: value
        for f in fitted
        for n, value, sigma in zip(f.names, f.solution.values.tolist(), f.solution.sigma.tolist(), strict=True)
        if sigma < CERTAIN * abs(value)
    }
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
    return settings.with_values(far)


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
