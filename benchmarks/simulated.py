"""Motions that the benchmarks fit: simulated once with exact stick and slip, kept in a folder, then measured."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np

import joint_id_core
from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import Model, build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import ControlledJoint, PositionController
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

MODEL_1 = build("rigid_joint")
MODEL_2 = build("harmonic_drive")
MODEL_3 = build("electromechanical")
SENSORS = Sensors(
    noise={
        "current": 0.05,
        "motor_position": 1e-3,
        "link_position": 1e-5,
        "motor_velocity": 0.1,
        "link_velocity": 1e-3,
    }
)
RATE = 500  # Hz, of the closed loop
VOLTAGE, VOLTAGE_STEP_S, VOLTAGE_RATE = (12.0, -12.0, 6.0, -6.0), 0.5, 1000  # V, s, Hz
COLOURED_S = 0.02  # time constant of coloured torque noise
RIPPLE_PER_TURN = 2  # periods of the torque ripple in a turn of the motor


@dataclass(frozen=True)
class Torque:
    """Torque at the motor shaft in Nm that moves the joint and is not in the recorded one; held over a sample.

    Attributes:
        white: standard deviation of white noise.
        coloured: standard deviation of a first-order process with time constant `COLOURED_S`.
        ripple: amplitude of a torque that follows the angle of the motor.
    """

    white: float = 0.0
    coloured: float = 0.0
    ripple: float = 0.0

    def noise(self, samples: int, seed: int) -> Array:
        """What does not depend on the motion, shape (samples,); its white part is that of `simulate_closed_loop`."""
        total = self.white * np.random.default_rng(seed).standard_normal(samples)
        if self.coloured:
            kept = np.exp(-1.0 / (RATE * COLOURED_S))
            driven = np.sqrt(1.0 - kept**2) * np.random.default_rng([seed, 1]).standard_normal(samples)
            driven[0] /= np.sqrt(1.0 - kept**2)
            for k in range(1, samples):
                driven[k] += kept * driven[k - 1]
            total = total + self.coloured * driven
        return np.asarray(total, dtype=float)


@dataclass(frozen=True)
class ClosedLoop:
    """`samples` of a joint under position control on a multisine, at `RATE`, with all states.

    Attributes:
        samples: length.
        torque: what the recorded torque does not show.
        plant: what moves.
        values: changes to its nominal parameters.
        controller: that moves it.
        inputs: recorded beside the states.
    """

    inputs: ClassVar = ("torque",)
    samples: int = 1000
    torque: Torque = Torque()
    plant: Model = MODEL_2
    values: Mapping[str, float] = field(default_factory=dict)
    controller: PositionController = field(default_factory=PositionController)

    def motion(self, seed: int) -> Recording:
        """Simulate; `seed` is that of the torque's noise."""
        time = np.arange(self.samples) / RATE
        loop = ControlledJoint(self.plant, self.controller, position_reference(), self.values)
        rows, noise = [], self.torque.noise(self.samples, seed).tolist()
        for dt, unseen in zip([*np.diff(time).tolist(), 1.0 / RATE], noise, strict=True):
            state, torque = loop.joint.state, loop.command()
            ripple = 0.0
            if self.torque.ripple:
                ripple = self.torque.ripple * float(np.sin(RIPPLE_PER_TURN * state["motor_position"]))
            rows.append({**state, "torque": torque})
            loop.joint.advance(dt, {"torque": torque + unseen + ripple})
        return Recording(time, {name: np.array([row[name] for row in rows]) for name in rows[0]})

    @property
    def key(self) -> str:
        """What the motion depends on beside the seed and the text of the simulation."""
        return repr((self.samples, self.torque, self.plant, sorted(self.values.items()), self.controller))


@dataclass(frozen=True)
class VoltageSteps:
    """Model 3 under steps of voltage, from rest. Nothing in it is random."""

    inputs: ClassVar = ("voltage",)

    def motion(self, seed: int) -> Recording:
        """Simulate; `seed` changes nothing."""
        length = round(VOLTAGE_STEP_S * VOLTAGE_RATE)
        time = np.arange(length * len(VOLTAGE)) / VOLTAGE_RATE
        return simulate(MODEL_3, time, {"voltage": np.repeat(VOLTAGE, length)})

    @property
    def key(self) -> str:
        """See `ClosedLoop`."""
        return repr(MODEL_3)


def motion(what: ClosedLoop | VoltageSteps, seed: int, cache: Path) -> Recording:
    """The motion without sensor noise, from the folder `cache` if it is there. Safe in several processes at once."""
    if isinstance(what, VoltageSteps):
        seed = 0
    key = hashlib.sha256(f"{type(what).__name__}{what.key}{_simulation_text()}".encode()).hexdigest()[:16]
    path = cache / f"{key}-{seed}.npz"
    if not path.exists():
        found = what.motion(seed)
        cache.mkdir(parents=True, exist_ok=True)
        draft = cache / f"{path.stem}.{os.getpid()}.draft.npz"
        np.savez(draft, time=found.time, **found.channels)  # type: ignore[arg-type]  # no channel is an option of savez
        draft.replace(path)
    with np.load(path) as arrays:
        channels = {name: arrays[name] for name in arrays.files if name != "time"}
        return Recording(arrays["time"], channels, source=f"{type(what).__name__} {seed}")


def start(model: Model, seed: int, factor: float) -> dict[str, float]:
    """Start values of the parameters that the table frees, each off by up to `factor`, up or down."""
    free = [p for p in model.parameters if not p.fixed]
    off = np.exp(np.log(factor) * np.random.default_rng(100 + seed).uniform(-1.0, 1.0, len(free)))
    return {p.name: p.nominal * by for p, by in zip(free, off.tolist(), strict=True)}


@lru_cache(maxsize=1)
def _simulation_text() -> str:
    """Everything that a motion is made by: a change in it makes motions anew."""
    core = Path(joint_id_core.__file__).parent
    files = [
        Path(__file__),
        *(file for room in ("simulation", "models") for file in sorted((core / room).glob("*.py"))),
    ]
    return "".join(file.read_text() for file in files)
