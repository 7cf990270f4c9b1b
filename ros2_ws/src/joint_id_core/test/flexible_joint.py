"""A joint with a flexible gear and gravity under a position controller, with an encoder on both sides."""

from __future__ import annotations

import functools

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.simulation.excitation import build_multisine, harmonics
from joint_id_core.simulation.simulator import JointSimulator

MODEL = build("harmonic_drive")
TRUTH = MODEL.values({"k_2": 0.0, "c_1": 5.0, "c_q": 0.0, "tau_fq": 0.0, "w_sm": 1.0})
N = TRUTH["N"]
RATE = 250  # Hz
GRAVITY = 30.0  # Nm


@functools.cache
def flexible(
    seed: int = 0, noise: float = 3e-5, disturbance: float = 0.0, seconds: float = 20.0, k_2: float = 0.0
) -> Recording:
    """The recording of a slow motion.

    `noise` is that of both encoders, in rad at the link. The disturbance is a torque at the motor with this standard
    deviation in Nm and a memory of 0.15 s, to which the controller reacts.
    """
    rng, time = np.random.default_rng(1000 + seed), np.arange(round(seconds * RATE) + 1) / RATE
    path = build_multisine(0.8, harmonics(0.1, 1.0, 10.0), seed, roll_off=1.0)
    begin = float(path.value(0.0))
    joint = JointSimulator(MODEL, {**TRUTH, "k_2": k_2})
    kept, pushed = np.exp(-1.0 / (0.15 * RATE)), 0.0
    motor, link, torque = np.empty((3, len(time)))
    for k, t in enumerate(time.tolist()):
        now = joint.state
        motor[k], link[k] = now["motor_position"], now["link_position"]
        torque[k] = 15.0 * (path.value(t) - begin - link[k]) + path.rate(t) - now["motor_velocity"] / N
        pushed = kept * pushed + np.sqrt(1.0 - kept**2) * disturbance * rng.standard_normal()
        load = GRAVITY * (np.cos(link[k]) + 0.6 * np.sin(link[k]))
        joint.advance(1.0 / RATE, {"torque": float(torque[k] + pushed), "external_torque": float(load)})
    seen = noise * rng.standard_normal((2, len(time)))
    channels = {"motor_position": motor + N * seen[0], "link_position": link + seen[1], "torque": torque}
    return Recording(time, {**channels, "reference_position": path.value(time) - begin}, source="flexible")


def late(recording: Recording, seconds: float) -> Recording:
    """The recording with a link encoder that is late by so many s."""
    time, link = recording.time, recording["link_position"]
    return recording.with_channels({"link_position": np.interp(time - seconds, time, link)})


def stiffer(recording: Recording, factor: float) -> Recording:
    """The same joint in units that make stiffness, damping, friction and inertia larger by a factor."""
    return recording.with_channels({"torque": factor * recording["torque"]})
