"""A joint whose gear has hysteresis (Dahl: a torque that turns over some twist), or friction that grows with load."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import build
from joint_id_core.simulation.position_control import PositionController

PLAIN = build("harmonic_drive")
NAMES = ("N", "J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq")
RATE, STEPS = 500, 400  # samples per second, steps of the integration per sample
SMOOTHING = tuple(PLAIN.values()[f"w_s{side}"] for side in "mq")


@numba.njit
def _advance(
    x: Any, torque: float, p: Any, smoothing: Any, level: float, reach: float, grows: float, h: float, steps: int
) -> Any:
    N, J_m, c_m, tau_fm, c_1, k_1, k_2, J_q, c_q, tau_fq = p
    theta, q, w_m, w_q, z = x
    for _ in range(steps):
        twist, rate = theta / N - q, w_m / N - w_q
        z += h * (rate - abs(rate) * z) / reach
        spring = k_1 * twist + k_2 * twist**3 + c_1 * rate + level * z
        more = 1.0 + grows * abs(spring)
        w_m += h * (torque - c_m * w_m - more * tau_fm * math.tanh(w_m / smoothing[0]) - spring / N) / J_m
        w_q += h * (spring - c_q * w_q - more * tau_fq * math.tanh(w_q / smoothing[1])) / J_q
        theta += h * w_m
        q += h * w_q
    return theta, q, w_m, w_q, z


def moved(level: float, reach: float, reference: Any, seed: int, seconds: float = 6.0, grows: float = 0.0) -> Recording:
    """The joint under its position controller, with a hysteresis of `level` Nm that turns over `reach` rad.

    Coulomb friction grows by the share `grows` for each Nm that the gear transmits.
    """
    rng, controller, values = np.random.default_rng(seed), PositionController(), PLAIN.values()
    p, count = tuple(values[n] for n in NAMES), round(RATE * seconds)
    noise = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.05}
    seen: dict[str, Array] = {name: np.empty(count) for name in (*noise, "torque")}
    q = float(reference.value(0.0))
    x = (q * values["N"], q, 0.0, 0.0, 0.0)
    for k in range(count):
        time = k / RATE
        for name, value in zip(noise, (x[0], x[1], x[2]), strict=True):
            seen[name][k] = value + noise[name] * rng.standard_normal()
        torque = controller.torque(
            float(reference.value(time)), float(reference.rate(time)), seen["link_position"][k],
            seen["motor_velocity"][k] / values["N"],
        )  # fmt: skip
        seen["torque"][k] = torque
        true = torque + 0.003 * rng.standard_normal()
        x = _advance(x, true, p, SMOOTHING, level, reach, grows, 1.0 / (RATE * STEPS), STEPS)
    return Recording(np.arange(count) / RATE, seen | {"external_torque": np.zeros(count)}, source="hysteresis")
