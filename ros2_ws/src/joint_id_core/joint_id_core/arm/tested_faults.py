"""Faults that the samples of an arm may have: the torque that a small one of each kind adds to every joint."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.arm.gravity_direction import pull_of
from joint_id_core.data.recording import Array

LATE, MEANWHILE = "late", "meanwhile"
ACROSS = 0.1  # share of gravity that an axis is across at least
GROSS = math.radians(30.0)  # an angle that no mounting is off by
ZERO = 2e-3  # rad, standard deviation of the zeros of joints of any robot
TOLD_SHARE = 0.05  # the same of a share of a torque: torque constants are known to 7 to 20 %
UNIT = "(unit, torque constant or gear ratio)"
TOLD_ZERO = math.radians(1.0)  # most standard deviation of a zero with which it is told from what else a law lacks


@dataclass(frozen=True)
class Suspect:
    """A fault.

    Attributes:
        name: of its kind, and of the axis or joint that it is of.
        text: what it is, by its amount; empty for an amount that no fault of the kind has.
        torque: of all joints by unit fault, of each recording, (R, n).
        most: amount beyond which it stands for something else.
        usual: standard deviation of the amount that robots have anyway.
        clear: most standard deviation of the amount with which it is asked for, unless it is beyond `most`.
    """

    name: str
    text: Callable[[float], str]
    torque: Sequence[Array]
    most: float = math.inf
    usual: float = 0.0
    clear: float = math.inf


def tested_faults(description: Description, parts: Sequence[Equations], whole: Array) -> Iterator[Suspect]:
    """Yield the faults that are tested; `whole` are the values of all parameters, those of a payload included."""
    joints = list(zip(description.joints, description.turning.tolist(), strict=True))
    down, first, own = description.gravity, parts[0].base, np.eye(len(joints))
    yield Suspect(LATE, lambda s: f"the torques seem to be {1e3 * s:.2g} ms late", [-part.rate for part in parts])
    if down.any():
        mass, moments = float(whole[first]), whole[first + 1 : first + 4]
        payload = (mass, moments / mass) if any(part.loaded for part in parts) and mass > 0.0 else None
        carrying = Description(description.text, description.source, down.tolist(), payload)
        empty, carried = pull_of(description), pull_of(description, payload)
        at = [(carried if part.loaded else empty)(part.q) for part in parts]
        for axis, name in zip(np.eye(3), "xyz", strict=True):
            if np.linalg.norm(across := np.cross(axis, down)) > ACROSS * np.linalg.norm(down):
                yield Suspect(f"gravity {name}", partial(_turned, name), [some @ across for some in at], GROSS)
        arms = [carrying if part.loaded else description for part in parts]
        slopes = [arm.by_position(part.q, part.dq, part.ddq) for arm, part in zip(arms, parts, strict=True)]
        for j, (name, turns) in enumerate(joints):
            moved = [slope[:, :, j] for slope in slopes]
            limits = (GROSS, ZERO, TOLD_ZERO) if turns else ()
            yield Suspect(f"zero {name}", partial(_off_zero, name, turns), moved, *limits)
    for j, (name, turns) in enumerate(joints):
        yield Suspect(f"spring {name}", partial(_pulled, name, turns), [part.q * own[j] for part in parts])
    modelled = [_modelled(part, whole) for part in parts]  # recorded ones hold what is left of them, too
    for j, (name, _) in enumerate(joints):
        scaled = [torque * own[j] for torque in modelled]
        yield Suspect(f"torque {name}", partial(_too_large, name), scaled, clear=TOLD_SHARE)
    for loaded in (False, True):
        for k in [k for k, part in enumerate(parts) if part.loaded == loaded][1:]:
            more = [part.columns[:, :, first] * (i == k) for i, part in enumerate(parts)]
            what = "payload" if loaded else "last link"
            yield Suspect(f"{what} {k + 1}", partial(_carries, k + 1, what), more)
    for k, part in enumerate(parts):
        later = np.where(part.time > part.time.mean(), 1.0, 0.0)
        more = [p.columns[:, :, first] * later[:, None] if i == k else 0.0 * p.y for i, p in enumerate(parts)]
        when = f"in recording {k + 1}" if len(parts) > 1 else MEANWHILE
        yield Suspect(f"load {when}", partial(_changes, when), more)


def _modelled(part: Equations, whole: Array) -> Array:
    """Return the torques in Nm that values of all parameters make, (R, n)."""
    values = whole[: part.columns.shape[2]].copy()
    values[part.base : part.base + PAYLOAD] *= part.loaded
    return np.asarray(part.columns @ values)


def _turned(axis: str, amount: float) -> str:
    return f"gravity seems to be turned by {math.degrees(amount):.2g} degrees about {axis} of the base (base_gravity)"


def _off_zero(joint: str, turns: bool, amount: float) -> str:
    if not turns:
        return f"the zero of {joint} seems to be off by {-1e3 * amount:.2g} mm"
    other = "" if abs(amount) < GROSS else ", or its axis to point the other way, or joints to be exchanged"
    return f"the zero of {joint} seems to be off by {-math.degrees(amount):.2g} degrees{other}"


def _pulled(joint: str, turns: bool, amount: float) -> str:
    if amount < 0.0:
        return ""  # no spring pushes away from where it rests
    return f"something pulls at {joint} as a spring of {amount:.2g} {'Nm/rad' if turns else 'N/m'}"


def _too_large(joint: str, amount: float) -> str:
    than = "large" if amount > 0.0 else "small"
    return f"the torque of {joint} seems to be {math.exp(abs(amount)):.2g} times too {than} {UNIT}"


def _carries(recording: int, what: str, amount: float) -> str:
    more = "more" if amount > 0.0 else "less"
    return f"the {what} seems to have about {abs(amount):.2g} kg {more} in recording {recording} than in the others"


def _changes(when: str, amount: float) -> str:
    return f"the load of the last link seems to change {when}, by about {amount:.2g} kg"
