"""Records of simulated joints that change, or whose sensors fail, while they are watched."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.simulation.position_control import ControlledJoint
from online.cases import BEFORE_S, Case
from online.joints import SENSORS, Joint, VoltageJoint

MOVED_S, NOTICED = 0.5, 0.01  # s, rad at the link
STEP_S = 1.0  # in which a drift is simulated
OFFSET_A, LATE_S = 0.05, 5e-3
Channels = dict[str, Array]


@dataclass(frozen=True)
class Watched:
    """A record, and what is true in it.

    Attributes:
        recording: what the identifier gets.
        since: instant of the change in s.
        truth: by name the true parameters at an instant in s.
        moves: whether the joint moved noticeably in the half second before an instant in s.
    """

    recording: Recording
    since: float
    truth: Callable[[float], Mapping[str, float]]
    moves: Callable[[float], bool]


def records(joint: Joint, motion: str, seed: int, cases: Sequence[Case]) -> Iterator[tuple[Case, Watched]]:
    """A record of each case. They share the motion before the change, so that this is simulated only once."""
    values = joint.values(seed)
    loop = joint.moving(motion, values, seed)
    before = stretch(loop, BEFORE_S[motion], joint.rate)
    for case in cases:
        yield case, _record(joint, case, copy.deepcopy(loop), before, values, case.after_s[motion], seed)


def steady(joint: Joint, motion: str, seed: int, seconds: float) -> Watched:
    """A record without any change."""
    values = joint.values(seed)
    shown, true = stretch(joint.moving(motion, values, seed), seconds, joint.rate)
    truth, time = joint.truth(values), _time(shown, joint.rate)
    return Watched(joint.recording(time, shown), 0.0, lambda _: truth, moves(time, true))


def stretch(loop: ControlledJoint | VoltageJoint, seconds: float, rate: float) -> tuple[Channels, Channels]:
    """What sensors and inputs show while a joint moves on, and the true states; arrays (T,) by channel."""
    rows, states = [], []
    for _ in range(round(seconds * rate)):
        shown = loop.shown
        states.append(loop.joint.state)
        rows.append({**shown, **loop.tick(1.0 / rate)})
    return _columns(rows), _columns(states)


def _record(
    joint: Joint,
    case: Case,
    loop: ControlledJoint | VoltageJoint,
    before: tuple[Channels, Channels],
    values: dict[str, float],
    after_s: float,
    seed: int,
) -> Watched:
    parts, since = [before], loop.joint.time
    changed = joint.parts.get(case.part, ())

    def at(time: float) -> dict[str, float]:
        """Parameters of the plant at an instant."""
        passed = time - since
        if passed <= 0.0 or not changed:
            return values
        by = 1.0 + (case.factor - 1.0) * passed / 3600.0 if case.drift else case.factor
        return {**values, **{n: by * values[n] for n in changed}}

    for _ in range(round(after_s / STEP_S) if case.drift else 1):
        loop.change(at(loop.joint.time + 0.5 * STEP_S))
        parts.append(stretch(loop, STEP_S if case.drift else after_s, joint.rate))
    shown, true = (joined([part[k] for part in parts]) for k in (0, 1))
    time, offset = _time(shown, joint.rate), 0.0
    fault = FAULTS.get(case.fault)
    if fault is not None:
        fault(joint, time, shown, true, time >= since - 0.5 / joint.rate, np.random.default_rng([seed, 12]))
        offset = OFFSET_A if case.fault == "offset" else 0.0
    recording = joint.recording(time, shown)
    return Watched(recording, since, lambda t: joint.truth(at(t), offset if t > since else 0.0), moves(time, true))


def _frozen(
    joint: Joint, time: Array, shown: Channels, true: Channels, failed: Array, rng: np.random.Generator
) -> None:
    """The sensor shows its last value for ever."""
    y = shown[joint.encoder]
    y[failed] = y[int(np.argmax(failed))]


def _late(joint: Joint, time: Array, shown: Channels, true: Channels, failed: Array, rng: np.random.Generator) -> None:
    """The sensor shows what was `LATE_S` ago, with noise of its own."""
    was = CubicSpline(time, true[joint.encoder])(time[failed] - LATE_S)
    shown[joint.encoder][failed] = SENSORS.reading(joint.encoder, was, rng)


def _off(joint: Joint, time: Array, shown: Channels, true: Channels, failed: Array, rng: np.random.Generator) -> None:
    """The sensor of the current shows too much."""
    shown["current"][failed] += OFFSET_A


FAULTS = {"frozen": _frozen, "late": _late, "offset": _off}


def _columns(rows: Sequence[Mapping[str, float]]) -> Channels:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def joined(parts: Sequence[Channels]) -> Channels:
    """Stretches that follow each other, as one."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _time(channels: Channels, rate: float) -> Array:
    return np.arange(len(next(iter(channels.values())))) / rate


def moves(time: Array, true: Channels) -> Callable[[float], bool]:
    """Return `Watched.moves` of true states."""
    at_link = "link_velocity" in true
    speed = np.abs(true["link_velocity"] if at_link else true["motor_velocity"] / GEAR_RATIO)
    way = np.cumsum(speed) * (time[1] - time[0])
    return lambda t: bool(np.diff(np.interp([t - MOVED_S, t], time, way))[0] > NOTICED)
