"""Motion of a rigid joint for tests of the online identifier."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

MODEL = build("rigid_joint")
TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}
RATE = 250  # Hz
NOISE = 1e-5  # rad, standard deviation of the encoder


@functools.cache
def motion(seconds: float = 20.0, seed: int = 0) -> Recording:
    """A rigid joint under a multisine of 2 s period, so that every window shows as much as any other."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    torque = multisine(time, 25.0, (0.5, 1.5, 2.5, 4.0), seed=5)
    moved = simulate(MODEL, time, {"torque": torque + 0.1 * rng.standard_normal(len(time))}, TRUTH)
    seen = Sensors(noise={"link_position": NOISE}).measure(moved, seed, keep=("link_position",))
    return seen.with_channels({"torque": torque})


def batches(recording: Recording, size: int = 25) -> Iterator[Recording]:
    """Parts of a recording, `size` samples long."""
    return (recording.slice(i, i + size) for i in range(0, len(recording), size))
