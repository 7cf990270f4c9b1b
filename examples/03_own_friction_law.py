"""Add a friction term of your own to a model: drag that grows with the square of the speed.

The one `derivative` is simulated, differentiated with SymPy and compiled. It may use + - * /, integer powers and
`ops.sin`, `cos`, `exp`, `asinh`, `direction`; no `if`, no `abs`.
"""

from dataclasses import dataclass

import numpy as np

import joint_id_core as jid
from joint_id_core.data.signals import positive
from joint_id_core.models import RigidJoint


@dataclass(frozen=True)
class Drag(RigidJoint):
    """Rigid joint with quadratic drag."""

    name = "drag"
    summary = "rigid joint with drag that grows with the square of the speed"

    @property
    def parameters(self):
        return (*super().parameters, positive("c_2", "Nm s^2/rad^2", "quadratic drag", 1.0))

    def derivative(self, x, u, p, ops):
        velocity, acceleration = super().derivative(x, u, p, ops)
        drag = p.c_2 * x[1] ** 2 * ops.direction("link_velocity", x[1], p.w_s)
        return velocity, acceleration - drag / p.J


time = np.arange(1501) / 500
torque = 60 * np.sin(2 * np.pi * 0.7 * time) + 20 * np.sin(2 * np.pi * 2.3 * time)
truth = {"J": 2.0, "c": 3.0, "tau_f": 4.0, "c_2": 1.5}
motion = jid.simulate(Drag(), time, {"torque": torque}, truth)
noise = 2e-5 * np.random.default_rng(1).standard_normal(len(time))
measured = jid.Recording(time, {"link_position": motion["link_position"] + noise, "torque": torque})

estimate = jid.fit(Drag(), measured)
print(estimate)
for name, value in truth.items():
    print(f"{name}: {estimate[name].value:.4g} ± {estimate[name].std_dev:.1g}, the truth is {value:g}")
