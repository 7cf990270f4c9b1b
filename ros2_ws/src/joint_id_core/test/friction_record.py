"""Records of a rigid joint whose friction law is known."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}


OF_LAW = {"coulomb_viscous": {}, "stribeck": {"dtau_s": 1.0, "w_b": 0.2}, "eyring": {"w_e": 0.5}}


@functools.cache
def rigid(law: str, seed: int = 0) -> Recording:
    """Four seconds of a rigid joint with exact stick and slip, reversing often, torque with noise."""
    time = np.arange(1600) / 400
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(len(time))
    motion = simulate(build("rigid_joint", friction=law), time, {"torque": torque + noise}, TRUTH | OF_LAW[law])
    seen = Sensors(noise={"link_position": 1e-5}).measure(motion, seed, keep=("link_position",))
    return replace(seen.with_channels({"torque": torque}), source="joint")
