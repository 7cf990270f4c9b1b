"""Write a model of your own: a pendulum whose pivot has friction, driven by a torque.

A model is four things: its states, inputs, parameters and one `derivative` in plain arithmetic.
"""

from dataclasses import dataclass

import numpy as np

import joint_id_core as jid
from joint_id_core.data.signals import Parameter, channel, positive


@dataclass(frozen=True)
class Pendulum(jid.Model):
    """J ddq = tau - c dq - tau_f dir(dq) - m_gl sin(q)."""

    name = "pendulum"
    summary = "pendulum with friction in its pivot"

    @property
    def states(self):
        return (channel("link_position"), channel("link_velocity"))

    @property
    def inputs(self):
        return (channel("torque"),)

    @property
    def parameters(self):
        return (
            positive("J", "kg m^2", "inertia about the pivot", 1.0),
            positive("c", "Nm s/rad", "viscous friction", 0.5),
            positive("tau_f", "Nm", "Coulomb friction", 0.5),
            positive("m_gl", "Nm", "mass times gravity times length", 5.0),
            Parameter("w_s", "rad/s", "velocity that smooths the Coulomb step", 0.01, lower=1e-6, fixed=True),
        )

    def derivative(self, x, u, p, ops):
        q, dq = x
        friction = p.c * dq + p.tau_f * ops.direction("link_velocity", dq, p.w_s)
        return dq, (u[0] - friction - p.m_gl * ops.sin(q)) / p.J


time = np.arange(2001) / 500
torque = 8 * np.sin(2 * np.pi * 0.5 * time) + 4 * np.sin(2 * np.pi * 1.7 * time)
truth = {"J": 1.5, "c": 0.8, "tau_f": 0.4, "m_gl": 9.0}
motion = jid.simulate(Pendulum(), time, {"torque": torque}, truth)
noise = 5e-5 * np.random.default_rng(2).standard_normal(len(time))
measured = jid.Recording(time, {"link_position": motion["link_position"] + noise, "torque": torque})

estimate = jid.fit(Pendulum(), measured)
for name, value in truth.items():
    print(f"{name}: {estimate[name].value:.4g} ± {estimate[name].std_dev:.1g}, the truth is {value:g}")
