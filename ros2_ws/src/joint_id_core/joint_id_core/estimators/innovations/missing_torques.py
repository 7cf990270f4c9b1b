"""Torques that joint models most often lack, as shapes over time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import side_of
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.hysteresis import hysteresis
from joint_id_core.models import Model

FORESEEN = (-1.0, 1.0, 0.5, 0.0, -0.5)  # straight line through the last four samples, minus the present one
ROUNDING = 1e-12  # range over largest value below which a signal is constant
NEAR_ZERO = 0.2  # twist at which a gear with play is taken to be on one side, as a fraction of its rms
REACH = 0.5  # twist over which hysteresis of a gear, or friction, turns, as a fraction of its rms
LOW_SPEED = 0.1  # Stribeck velocity of the low-speed shape, as a fraction of the rms speed


@dataclass(frozen=True)
class Shape:
    """A torque that the model may lack.

    Attributes:
        name: name in messages.
        advice: what the user can try.
        parts: where it acts (as in `Recursion.disturbances`), and its values over time there, shape (T,), up to a
            common factor.
        sensor: True for noise of the input's sensor, which does not move the joint; its size is then positive.
        replaced: True for play, hysteresis and the like, in whose place parameters go far from their values. Their size
            is positive, too.
        measure: factor and unit of the size of the course, if that is of use; else None.
        general: True for one that many other causes look like in part. It is taken, and told of, if it says far more.
        by_sign: True for a gain of the drive that differs by its sign, which no other cause looks like: colour of the
            residual torque of real robots is taken for a gain that changes with its size.
    """

    name: str
    advice: str
    parts: tuple[tuple[int, Array], ...]
    sensor: bool = False
    replaced: bool = False
    measure: tuple[float, str] | None = None
    general: bool = False
    by_sign: bool = False


def shapes(data: FitData, states: Array, p: Array) -> list[Shape]:
    """Return torques that the model may lack, along the filtered `states` (T, n), with all parameters `p` (P,)."""
    model, value = data.model, dict(zip(data.model.parameter_names, p.tolist(), strict=True))
    names, inputs = model.state_names, model.input_names
    known = dict(zip((*inputs, *names), np.concatenate([data.u, states], axis=1).T.copy(), strict=True))
    drive = inputs.index(model.torque_drive) if model.torque_drive is not None else None
    load = inputs.index(model.load) if model.load is not None else drive
    motor = len(inputs) if drive is None and model.motor_inertias else drive  # see `Recursion.disturbances`
    found = []
    for velocity, smoothing in model.smoothing.items():
        side = side_of(velocity)
        channel = motor if side == "motor" else load
        if channel is None:
            continue
        w = known[velocity]
        size = np.abs(w)
        speed = math.sqrt(float(w @ w) / len(w)) or 1.0
        rise = np.tanh(w / max(value[smoothing], 0.01 * speed)) * np.exp(size * (-1.0 / (LOW_SPEED * speed)))
        text = f"friction at the {side} that changes at low speed"
        found.append(Shape(text, _other_law(model, "stribeck"), ((channel, rise),)))
        text = f"friction at the {side} that bends with speed"
        found.append(Shape(text, _other_law(model, "eyring"), ((channel, w * size),)))
    if "link_position" in names and load is not None and not model.has_gravity:
        q, advice = known["link_position"], "try --gravity"
        if "drifting_load" in names:
            advice = "the drifting load is no random walk there"
        found.append(Shape("a load that goes with the angle", advice, ((load, _around_mean(q)),)))
    if drive is not None and not model.has_torque_offset:
        found.append(Shape("a constant torque", "try --offsets", ((drive, np.ones(len(states))),)))
    if drive is not None:
        text = f"noise in the recorded {inputs[drive]} that does not move the joint"
        part = (drive, unforeseen(known[inputs[drive]]))
        found.append(Shape(text, f"record the commanded {inputs[drive]}", (part,), sensor=True))
    if drive is not None and model.stiffness is None:
        found += _of_the_gain(known[inputs[drive]], inputs[drive], drive)
    if motor is not None and model.stiffness is not None and {"motor_position", "link_position"} <= known.keys():
        found += _with_a_spring(data, known, value, motor)
    return found


def _other_law(model: Model, law: str) -> str:
    """Return the advice to take a law of friction, or what it means where the model has it already."""
    return f"the {law} law does not follow it" if getattr(model, "friction", "") == law else f"try --friction {law}"


def _of_the_gain(u: Array, name: str, drive: int) -> list[Shape]:
    """Return what a motor or a sensor that is not linear adds to the recorded drive `u` (T,).

    Of a drive that stays around a value, as one that holds a load does, another gain is one of all torques: no shape.
    """
    away, size = _around_mean(u), np.abs(u)
    spread = float(away @ away)
    slope = float(away @ size) / spread if spread > 0.0 else 0.0
    advice, text = "the joint has another torque than was recorded", f"a gain of the recorded {name}"
    return [
        Shape(f"{text} that changes with its size", advice, ((drive, away**3),), general=True),
        Shape(f"{text} that differs by its sign", advice, ((drive, size - slope * away),), general=True, by_sign=True),
    ]


def unforeseen(drive: Array) -> Array:
    """Return the part of a drive (T,) that its last samples do not foresee, with the opposite sign, shape (T,).

    Noise of the drive itself is independent of the recorded signal; noise of a sensor is part of that signal. What is
    expected is predicted from past samples only: later ones contain the controller's reaction to the drive's own noise.
    """
    found = np.zeros(len(drive))
    found[len(FORESEEN) - 1 :] = np.correlate(drive, FORESEEN[::-1], "valid")
    return found


def _with_a_spring(data: FitData, known: dict[str, Array], value: dict[str, float], motor: int) -> list[Shape]:
    """Return torques that a joint with a spring may lack; those of the spring push the motor, and the link backwards.

    After a reversal the spring unwinds. Friction that turns over such a distance looks like a stiffer one.
    """
    model, ratio = data.model, data.model.gear_ratio(value)
    load = None if model.load is None else model.input_names.index(model.load)
    twist = known["motor_position"] / ratio - known["link_position"]
    twist = _around_mean(twist) if model.twist_offset is None else twist - value[model.twist_offset]
    side = np.tanh(twist / (NEAR_ZERO * math.sqrt(float(twist @ twist) / len(twist)) or 1.0))

    def pushing(torque: Array) -> tuple[tuple[int, Array], ...]:
        at_motor = (motor, torque / (ratio * (model.torque_constant(value) or 1.0)))
        return (at_motor,) if load is None else (at_motor, (load, torque))

    reach = REACH * math.sqrt(float(twist @ twist) / len(twist)) or 1.0
    name, advice = "play in the gear", "let a load keep the gear on one side"
    slope = np.full(len(twist), value[str(model.stiffness)])
    if model.cubic_stiffness is not None:
        slope += 3.0 * value[model.cubic_stiffness] * twist * twist
    # A little play, at the stiffness that was found; and much of it, in whose place the spring became soft.
    found = [Shape(name, advice, pushing(slope * side), replaced=True, measure=(1e3, "mrad to each side"))]
    found.append(Shape(name, advice, pushing(side), replaced=True))
    name, advice = "hysteresis of the gear", f"a part of {model.gear_damping} is that"
    found.append(Shape(name, advice, pushing(-hysteresis(twist, reach)), replaced=True, measure=(1.0, "Nm")))
    # A torque of the drive pushes the joint, one of the load holds it as friction does.
    sides = [("motor", motor, -1.0, ratio * reach)] + ([] if load is None else [("link", load, 1.0, reach)])
    for name, channel, sign, distance in sides:
        direction = np.sign(known[f"{name}_velocity"])
        late = sign * (hysteresis(known[f"{name}_position"], distance) - direction)
        text = f"friction at the {name} that turns over some distance"
        found.append(Shape(text, "no friction law has that", ((channel, late),), replaced=True))
        grows = sign * np.abs(slope * twist) * direction
        text = f"friction at the {name} that grows with the load"
        found.append(Shape(text, "no friction law has that", ((channel, grows),), replaced=True))
    if model.cubic_stiffness is not None and model.cubic_stiffness not in data.free:
        text = "a spring that is not linear as the model has it"
        found.append(Shape(text, f"try --free {model.cubic_stiffness}", pushing(twist * twist * twist)))
    return found


def _around_mean(course: Array) -> Array:
    """Return a signal minus its mean; zero if it is constant, so that rounding does not look like a shape."""
    away = course - course.mean()
    return away if np.ptp(course) > ROUNDING * np.max(np.abs(course)) else np.zeros_like(course)
