"""What is known of the uncertainty of values that a fit holds, told with its estimate."""

from __future__ import annotations

from dataclasses import replace

from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import Verdict

CONSTANT = "k_t"  # of the torque: with a current as drive it scales every torque of the joint


def with_held_values(estimate: Estimate, model: Model, settings: ParameterSettings | None) -> Estimate:
    """Return an estimate whose held parameters have the standard deviations that the user has given for them."""
    known = {} if settings is None else settings.deviations
    held = {p.name for p in estimate.parameters if p.verdict is Verdict.FIXED and p.name in known} if known else ()
    if not held:
        return estimate
    rows = tuple(replace(p, std_dev=known[p.name]) if p.name in held else p for p in estimate.parameters)
    shares = [f"{p.name} to {100.0 * p.std_dev / abs(p.value):.2g} %" for p in rows if p.name in held and p.value]
    said = f"held values are known only so far, which is in no standard deviation: {listed(shares)}"
    if CONSTANT in held and model.torque_drive == "current":
        said += f"; all inertias, frictions and stiffnesses scale with {CONSTANT}"
    return replace(estimate, parameters=rows, notes=(*estimate.notes, sentence(said)))
