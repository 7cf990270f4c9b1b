"""A joint whose gear has play, which no model of this package has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models.electromechanical import Electromechanical
from joint_id_core.models.harmonic_drive import HarmonicDrive
from joint_id_core.models.transmission import spring_torque
from joint_id_core.simulation.excitation import STEPS_V, Multisine
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

# To and fro, as in ordinary work, after a start with a jerk; rad, Hz, rad.
CALM = Multisine((0.6, 0.25), (0.143, 0.366), (-1.571, -0.571))
SENSORS = Sensors(noise={"link_position": 1e-5, "motor_position": 1e-3, "motor_velocity": 0.05})


def _spring(twist: float, rate: float, half: float, p: Any) -> float:
    beyond = twist - half if twist > half else min(twist + half, 0.0)
    return spring_torque(beyond, rate, p) if beyond else 0.0


@dataclass(frozen=True)
class GearWithPlay(HarmonicDrive):
    """Model 2 whose spring touches only beyond this twist to either side, in rad at the link."""

    half: float = 0.0

    def derivative(self, x: Any, u: Any, p: Any, ops: Any) -> tuple[Any, ...]:
        theta_m, q, w_m, w_q = x
        torque, external = u
        spring = _spring(theta_m / p.N - q, w_m / p.N - w_q, self.half, p)
        motor = (torque - self._motor_friction.torque(w_m, p, ops) - spring / p.N) / p.J_m
        link = (spring - self._link_friction.torque(w_q, p, ops) - external) / p.J_q
        return (w_m, w_q, motor, link)


@dataclass(frozen=True)
class MotorAndGearWithPlay(Electromechanical):
    """The same of Model 3."""

    half: float = 0.0

    def derivative(self, x: Any, u: Any, p: Any, ops: Any) -> tuple[Any, ...]:
        i, theta_m, q, w_m, w_q = x
        voltage, external = u
        spring = _spring(theta_m / p.N - q, w_m / p.N - w_q, self.half, p)
        friction = p.c_b * w_m + self._motor_friction.torque(w_m, p, ops)
        motor = (p.k_t * i - friction - spring / p.N) / p.J_m
        link = (spring - self._link_friction.torque(w_q, p, ops) - external) / p.J_q
        return ((voltage - p.R * i - p.k_b * w_m) / p.L, w_m, w_q, motor, link)


def stepped(half: float, seed: int, seconds: float = 6.0) -> Recording:
    """Model 3 under voltage steps, at 500 Hz."""
    time = np.arange(round(500 * seconds)) / 500
    voltage = np.array(STEPS_V)[(2.0 * time + 1e-9).astype(int) % len(STEPS_V)]
    noise = {"link_position": 1e-5, "motor_velocity": 0.05, "current": 0.01}
    noisy = voltage + 0.02 * np.random.default_rng(seed).standard_normal(len(time))
    inputs = {"voltage": noisy, "external_torque": np.zeros(len(time))}
    shown = Sensors(noise=noise).measure(simulate(MotorAndGearWithPlay(half=half), time, inputs), seed, tuple(noise))
    return shown.with_channels(inputs | {"voltage": voltage})


def moved(half: float, reference: Any, seed: int, seconds: float = 6.0) -> Recording:
    """The joint under its position controller, at 500 Hz."""
    time = np.arange(round(500 * seconds)) / 500
    recording = simulate_closed_loop(
        GearWithPlay(half=half), PositionController(), reference, time, torque_noise=0.003, seed=seed, sensors=SENSORS
    )
    kept = ("motor_position", "link_position", "motor_velocity", "torque", "external_torque")
    return Recording(time, {name: recording[name] for name in kept}, source="gear with play")
