"""A good recording of a rigid joint, and the same with faults."""

from __future__ import annotations

import functools

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

MODEL = build("rigid_joint")
TRUTH = {"J": 2.0, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}
POSITION, VELOCITY = 1e-5, 1e-3  # standard deviations of the noise


@functools.cache
def moved(rate: int = 500, seconds: float = 10.0) -> Recording:
    """A rigid joint under a multisine up to 4 Hz, without noise."""
    time = np.arange(round(seconds * 1000)) / 1000
    torque = multisine(time, 25.0, (0.5, 1.5, 2.5, 4.0), seed=5)
    motion = simulate(MODEL, time, {"torque": torque}, TRUTH)
    names = ("link_position", "link_velocity", "torque")
    return Recording(time[:: 1000 // rate], {n: motion[n][:: 1000 // rate] for n in names})


def good(rate: int = 500, seed: int = 0, noise: float = 1.0) -> Recording:
    sensors = Sensors(noise={"link_position": noise * POSITION, "link_velocity": noise * VELOCITY, "torque": 0.02})
    return sensors.measure(moved(rate), seed)


def scaled(name: str, factor: float) -> Recording:
    return good().with_channels({name: factor * good()[name]})


def later(name: str, seconds: float) -> Recording:
    """The same recording with one channel that is late."""
    record = good()
    return record.with_channels({name: np.interp(record.time - seconds, record.time, record[name])})


def with_rows(name: str, rows: list[int], values: object) -> Recording:
    changed = good()[name].copy()
    changed[rows] = values
    return good().with_channels({name: changed})


def frozen_rows(first: int, count: int) -> Recording:
    record = good()
    channels = {n: v.copy() for n, v in record.channels.items()}
    for values in channels.values():
        values[first : first + count] = values[first - 1]
    return Recording(record.time, channels)


LATER = (np.arange(5000) >= 3000).astype(float)
UNEVEN = np.random.default_rng(1).uniform(-1.0, 1.0, 5000)


def frozen(record: Recording, name: str, first: int, count: int) -> Recording:
    changed = record[name].copy()
    changed[first : first + count] = changed[first]
    return record.with_channels({name: changed})


def wrapped(turn: float) -> Recording:
    return good().with_channels({"link_position": np.mod(good()["link_position"], turn)})


def without_velocity(record: Recording) -> Recording:
    return only(record, "link_position", "torque")


def only(record: Recording, *names: str) -> Recording:
    return Recording(record.time, {n: record[n] for n in names})


def counts() -> Recording:
    return good().with_channels({"link_position": np.round(good()["link_position"] * 4096 / (2 * np.pi))})


def milliseconds() -> Recording:
    return at_times(1e3)


def at_times(unit: float, origin: float = 0.0) -> Recording:
    return Recording(origin + unit * good().time, good().channels)


def clipped(low: float, high: float) -> Recording:
    """A torque that is cut off at these quantiles, as by a converter behind its noise."""
    torque = good()["torque"]
    return good().with_channels({"torque": np.clip(torque, *np.quantile(torque, [low, high]))})


def drive_notes(estimate: Estimate) -> list[str]:
    """What a fit says of a drive that is early, late or of the wrong sign."""
    return [n for n in estimate.notes if "against the motion" in n]


TIME = np.arange(4000) / 500
# Commanded torques, and joints that rest: without fault, though values stay the same.
COMMANDS = {
    "steps and a rest": 12.0 * np.sign(np.sin(2.0 * TIME)) * (TIME < 6.0),
    "many steps": np.random.default_rng(0).uniform(-20.0, 20.0, 400).repeat(10),
    "bang-bang": np.random.default_rng(0).choice([-12.0, 12.0], 4000),
    "pulses": 12.0 * (np.sin(6.0 * TIME) > 0.8),
    "ramps": np.clip(20.0 * np.arcsin(np.sin(3.0 * TIME)), -12.0, 12.0),
    "rounded ramps": np.round(np.clip(20.0 * np.arcsin(np.sin(3.0 * TIME)), -12.0, 12.0), 2),
    "rounded sine": np.round(12.0 * np.sin(3.0 * TIME), 2),
    "coarse sine": np.round(12.0 * np.sin(3.0 * TIME)),
    "sine little above friction": 2.7 * np.sin(3.0 * TIME),
    "rest with less than friction": np.where(TIME < 4.0, 1.2 * np.sin(7.0 * TIME), 12.0 * np.sin(7.0 * TIME)),
    "rest": 12.0 * np.sin(7.0 * TIME) * (TIME > 4.0),
}  # fmt: skip
