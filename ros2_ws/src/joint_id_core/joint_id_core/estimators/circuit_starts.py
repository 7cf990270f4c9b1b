"""Start values of the circuit of a motor behind a gear: its equation holds whatever the motor moves.

A voltage drives a current through a resistance that a search can start from only if it is nearly right. The regression
of the circuit (paper Eq 4) is linear in `R` and `k_b`, and needs no start.
"""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.joint_size import certain
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model, build

CIRCUIT = ("R", "k_b")


def with_circuit(model: Model, recording: Recording, settings: ParameterSettings) -> ParameterSettings:
    """Return settings with start values of the circuit, if the model has one; what the user has set stays.

    The torque constant is as many times that of the table as `k_b` is: in SI units both are nearly the same.
    """
    if model.drive != "voltage" or "k_b" not in model.parameter_names:
        return settings
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    motor = build("dc_motor")
    given = {n: v for n, v in settings.values.items() if n in motor.parameter_names and n not in CIRCUIT}
    try:
        fitted = regressed(motor, recording, ParameterSettings(given), Regression())
    except JointIdError:
        return settings
    values = {n: v for n, v in certain(fitted).items() if n in CIRCUIT and v > 0.0}
    if "k_b" in values:
        values["k_t"] = values["k_b"] * model.parameter("k_t").nominal / model.parameter("k_b").nominal
    own = set(settings.names)
    return settings.with_values({n: v for n, v in values.items() if n not in own})
