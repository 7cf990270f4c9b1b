"""A rigid joint whose controller reacts to a disturbance with a memory, as on a real robot."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Recording

TRUTH = {"J": 0.6, "c": 4.0, "tau_f": 3.0}
RATE = 100  # Hz, of the recording
STEPS = 20  # of the integration in one sample


def controlled(
    disturbance: float, memory_s: float, seconds: float = 40.0, seed: int = 0, noise: float = 1e-5
) -> Recording:
    """The recording of a joint that a stiff position loop leads along a slow path.

    The disturbance is an Ornstein-Uhlenbeck torque with this standard deviation (Nm) and memory (s). The encoder has
    this noise in rad; the controller has one without.
    """
    rng = np.random.default_rng(seed)
    J, c, tau_f = TRUTH["J"], TRUTH["c"], TRUTH["tau_f"]
    dt = 1.0 / (RATE * STEPS)
    count = round(seconds * RATE)
    time = np.arange(count) / RATE
    fine = np.arange(count * STEPS) * dt
    path = 0.8 * np.sin(0.7 * fine) + 0.3 * np.sin(1.9 * fine + 1.0)
    speed = np.gradient(path, dt)
    q, w, d = float(path[0]), float(speed[0]), 0.0
    kept = np.exp(-dt / memory_s)
    push = np.sqrt(1.0 - kept**2) * disturbance * rng.standard_normal(len(fine))
    angles, torques = np.empty(count), np.empty(count)
    for k in range(count):
        wanted, fast = path[k * STEPS], speed[k * STEPS]
        torque = 900.0 * (wanted - q) + 45.0 * (fast - w) + tau_f * np.tanh(fast / 0.02)
        angles[k], torques[k] = q, torque
        for j in range(k * STEPS, (k + 1) * STEPS):
            d = kept * d + push[j]
            w += dt * (torque + d - c * w - tau_f * np.tanh(w / 0.02)) / J
            q += dt * w
    seen = angles + noise * rng.standard_normal(count)
    channels = {"link_position": seen, "torque": torques, "reference_position": path[::STEPS]}
    return Recording(time, channels, source="controlled")
