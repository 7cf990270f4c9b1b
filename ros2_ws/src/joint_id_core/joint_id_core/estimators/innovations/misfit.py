"""Test the residuals for torques that the model lacks, and add the resulting bias to the covariance.

A score (Lagrange multiplier) test (Breusch & Pagan 1980; Ljung, System Identification, 2nd ed., section 16.5): would
a small torque of a given shape, added to the drive or to the load, explain the residuals? The shapes are those that
joint models most often lack. A missing torque biases the estimates, and the square of this bias is added to their
covariance. This is done for a torque that is likely but not significant, too: a bias that hardly shows in the residuals
may still be large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import side_of
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.input_noise import attenuation
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData

LIKELY = 2.0  # size of a shape in standard deviations from which its bias counts; with a correct model 5 % reach it
CREDIBLE = 3.0  # the same for sensor noise, whose bias does not shrink with the size that is found
SIGNIFICANT = 4.0  # size from which the user is told; by chance it happens once in 16,000 tests
OWN_SHARE = 0.15  # least fraction of the information on a shape that the parameters do not explain as well
MOST = 2  # most shapes that are used together: with more they cancel each other, and their bias grows without limit
FORESEEN = (-1.0, 1.0, 0.5, 0.0, -0.5)  # straight line through the last four samples, minus the present one
TINY = 1e-300
ROUNDING = 1e-12  # range over largest value below which a signal is constant
LOW_SPEED = 0.1  # Stribeck velocity of the low-speed shape, as a fraction of the rms speed


@dataclass(frozen=True)
class Shape:
    """A torque that the model may lack.

    Attributes:
        name: name in messages.
        advice: what the user can try.
        channel: index of the input that it acts on.
        course: its values over time, up to a factor, shape (T,).
        sensor: True for noise of the input's sensor, which does not move the joint; its size is then positive.
    """

    name: str
    advice: str
    channel: int
    course: Array
    sensor: bool = False


@dataclass(frozen=True)
class Misfit:
    """Missing torques that were found.

    Attributes:
        found: the shapes, each with its size in standard deviations.
        excess: squares of their bias, to add to the covariance of the coordinates, shape (k, k).
    """

    found: tuple[tuple[Shape, float], ...]
    excess: Array

    @property
    def text(self) -> str:
        """The significant shapes in words; empty if none is significant."""
        parts = [f"{s.name} ({size:.3g} sigma: {s.advice})" for s, size in self.found if size > SIGNIFICANT]
        if not parts:
            return ""
        return f"the residuals show {' and '.join(parts)}; the standard deviations contain what that may do"


def shapes(data: FitData, states: Array, p: Array) -> list[Shape]:
    """Return torques that the model may lack, along the filtered `states` (T, n), with all parameters `p` (P,)."""
    model, value = data.model, dict(zip(data.model.parameter_names, p.tolist(), strict=True))
    names, inputs = model.state_names, model.input_names
    known = dict(zip((*inputs, *names), np.concatenate([data.u, states], axis=1).T.copy(), strict=True))
    drive = inputs.index(model.torque_drive) if model.torque_drive is not None else None
    load = inputs.index(model.load) if model.load is not None else drive
    found = []
    for velocity, smoothing in model.smoothing.items():
        side = side_of(velocity)
        channel = drive if side == "motor" and drive is not None else load
        if channel is None:
            continue
        w = known[velocity]
        size = np.abs(w)
        speed = math.sqrt(float(w @ w) / len(w)) or 1.0
        rise = np.tanh(w / max(value[smoothing], 0.01 * speed)) * np.exp(size * (-1.0 / (LOW_SPEED * speed)))
        found.append(
            Shape(f"friction at the {side} that changes at low speed", "try --friction stribeck", channel, rise)
        )
        text = f"friction at the {side} that bends with speed"
        found.append(Shape(text, "try --friction eyring", channel, w * size))
    if "link_position" in names and load is not None and not model.has_gravity:
        q = known["link_position"]
        found.append(Shape("a load that goes with the angle", "try --gravity", load, _around_mean(q)))
    if drive is not None and not model.has_torque_offset:
        found.append(Shape("a constant torque", "try --offsets", drive, np.ones(len(states))))
    if drive is not None:
        # Noise of the drive itself is independent of the recorded signal; noise of a sensor is part of that signal.
        # The expected value is predicted from past samples only: later samples contain the controller's reaction to
        # the drive's own noise.
        name, values = inputs[drive], known[inputs[drive]]
        surprise = np.zeros(len(values))
        surprise[len(FORESEEN) - 1 :] = np.correlate(values, FORESEEN[::-1], "valid")
        text, advice = f"noise in the recorded {name} that does not move the joint", f"record the commanded {name}"
        found.append(Shape(text, advice, drive, surprise, sensor=True))
    sides = {"motor_position", "link_position", "motor_velocity"}
    cubic = model.cubic_stiffness
    if sides <= known.keys() and drive is not None and cubic is not None and cubic not in data.free:
        twist = _around_mean(known["motor_position"] / model.gear_ratio(value) - known["link_position"])
        text = "a spring that is not linear as the model has it"
        found.append(Shape(text, f"try --free {cubic}", drive, twist * twist * twist))
    return found


def _around_mean(course: Array) -> Array:
    """Return a signal minus its mean; zero if it is constant, so that rounding does not look like a shape."""
    away = course - course.mean()
    return away if np.ptp(course) > ROUNDING * np.max(np.abs(course)) else np.zeros_like(course)


def misfit(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass) -> Misfit:
    """Test the residuals of a fit for missing torques, the most significant one first.

    Each further shape is tested together with those already found. `last` is the latest pass of the fit.
    """
    data = recursion.data
    p = recursion.values(coordinates.values(found.z))
    candidates = shapes(data, last.states, p)
    none = Misfit((), np.zeros_like(found.hessian))
    if not candidates:
        return none
    channel = np.array([s.channel for s in candidates], dtype=np.int64)
    course = np.array([s.course for s in candidates]).T
    cross, total, score = recursion.disturbances(last, channel, course)
    # a shape that is zero everywhere has no scale
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), TINY))
    slope = coordinates.slope(found.z)
    cross = slope[:, None] * cross * scale
    total = scale[:, None] * total * scale
    projected = cross.T @ found.inverse
    M = total - projected @ cross
    a = scale * score - projected @ (slope * last.gradient)
    enough = CREDIBLE * np.sqrt(np.maximum(np.diag(M), 0.0))
    possible = [k for k, s in enumerate(candidates) if not s.sensor or a[k] > enough[k]]
    taken: list[int] = []
    sizes: list[float] = []
    for _ in range(min(MOST, len(possible))):
        best, size = _most_significant(M, a, np.diag(total), possible, taken)
        if size < LIKELY:
            break
        taken.append(best)
        sizes.append(size)
        if candidates[best].sensor and size > SIGNIFICANT:
            candidates[best] = _rightly_named(recursion, coordinates, found, last, candidates[best])
    if not taken:
        return none
    torques = [k for k in taken if not candidates[k].sensor]
    bias = found.inverse @ cross[:, torques] @ np.linalg.solve(M[np.ix_(torques, torques)], a[torques])
    excess = np.outer(bias, bias)
    for k in set(taken).difference(torques):
        sensor = candidates[k].channel
        level = float(found.levels[len(data.labels) + sensor])
        bias = found.inverse @ attenuation(recursion, coordinates, found, {sensor: level}, last)
        excess += np.outer(bias, bias)
    return Misfit(tuple((candidates[k], size) for k, size in zip(taken, sizes, strict=True)), excess)


def _rightly_named(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, shape: Shape) -> Shape:
    """Return `shape`, noise of the drive's sensor, with the name of what else looks like it if it is that.

    A controller that knows more of the motion than is recorded answers to a disturbance before the filter has seen it.
    Then a drive below the foreseen one goes with a push forwards in the sample before. Noise of a sample has the other
    sign there: what is foreseen for the next sample goes on from it, and it has not moved the joint.
    """
    before = np.append(shape.course[1:], 0.0)
    cross, _, score = recursion.disturbances(last, np.array([shape.channel]), before[:, None])
    slope = coordinates.slope(found.z)
    if score[0] - (slope * cross[:, 0]) @ found.inverse @ (slope * last.gradient) < 0.0:
        return shape
    name = recursion.data.model.input_names[shape.channel]
    text = f"a recorded {name} that answers to motion which the recorded signals do not show yet"
    return replace(
        shape, name=text, advice="record all sensors that the controller reads, and the drive without a filter"
    )


def _most_significant(M: Array, a: Array, total: Array, possible: list[int], taken: list[int]) -> tuple[int, float]:
    """Return index and size in standard deviations of the shape that explains most in addition to those taken."""
    rest = [k for k in possible if k not in taken]
    sizes = []
    for k in rest:
        if taken:
            block = np.linalg.solve(M[np.ix_(taken, taken)], np.column_stack([M[taken, k], a[taken]]))
            information, score = M[k, k] - M[k, taken] @ block[:, 0], a[k] - M[k, taken] @ block[:, 1]
        else:
            information, score = M[k, k], a[k]
        sizes.append(abs(score) / np.sqrt(information) if information > OWN_SHARE * total[k] > 0.0 else 0.0)
    best = int(np.argmax(sizes))
    return rest[best], float(sizes[best])
