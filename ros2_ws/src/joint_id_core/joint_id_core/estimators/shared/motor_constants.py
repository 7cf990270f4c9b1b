"""Torque constant and voltage constant of a motor, which are one number in SI units.

What turns electrical into mechanical power is k_b w i on one side and k_t i w on the other; both are the same power
(Fitzgerald, Kingsley and Umans, Electric Machinery, 6th ed., ch. 7). So a recording checks its own units.
"""

from __future__ import annotations

import math

from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import Verdict

# Conventions of three-phase motors (line or phase voltage, peak or rms current) make a factor of up to sqrt(3).
LARGEST = 2.0
SIGMA = 4.0
RPM = 30.0 / math.pi  # revolutions a minute in a rad/s
SAME = 0.2  # deviation from a ratio that a unit would give


def unequal_constants(model: Model, estimate: Estimate) -> str:
    """Return a clause that says that the two constants of a motor differ too much for SI units; else nothing."""
    rows = {p.name: p for p in estimate.parameters if p.verdict is not Verdict.FIXED and p.value > 0.0}
    constants = [rows[name] for name in model.motor_constants if name in rows]
    if len(constants) < 2 or constants[0].verdict is not Verdict.ESTIMATED:
        return ""
    voltage, torque = constants
    ratio = voltage.value / torque.value
    if torque.verdict is Verdict.ESTIMATED:
        sigma = math.hypot(voltage.std_dev / voltage.value, torque.std_dev / torque.value)
        apart, size = abs(math.log(ratio)) - SIGMA * sigma > math.log(LARGEST), f"{ratio:.2g}"
    else:  # it is not known, but that it is small may be
        least = (voltage.value - SIGMA * voltage.std_dev) / (torque.value + SIGMA * torque.std_dev)
        apart, size = least > LARGEST, f"more than {least:.2g}"
    if not apart:
        return ""
    likely = "a channel is not in SI units, or is another quantity"
    if abs(ratio * RPM**2 - 1.0) < SAME:  # the velocity is in the voltage, and its derivative in the torque
        likely = "motor_velocity seems to be in revolutions a minute"
    held = [p.name for p in estimate.parameters if p.verdict is Verdict.FIXED and p.name in model.motor_inertias]
    wrong = f", or the held {' or '.join(held)} is that of another motor" if held else ""
    return (
        f"the voltage constant {voltage.name} is {size} times the torque constant {torque.name}, and in SI units "
        f"they are one number for any motor: {likely}{wrong}"
    )
