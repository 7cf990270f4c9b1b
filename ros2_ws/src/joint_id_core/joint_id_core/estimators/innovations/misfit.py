"""Test the residuals for torques that the model lacks, and add the resulting bias to the covariance.

A score (Lagrange multiplier) test (Breusch & Pagan 1980; Ljung, System Identification, 2nd ed., section 16.5): would
a small torque of a given shape, added to the drive or to the load, explain the residuals? The shapes are those that
joint models most often lack. A missing torque biases the estimates, and the square of this bias is added to their
covariance. This is done for a torque that is likely but not significant, too: a bias that hardly shows in the residuals
may still be large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.input_noise import attenuation
from joint_id_core.estimators.innovations.missing_torques import Shape, shapes
from joint_id_core.estimators.innovations.recursion import Pass, Recursion

LIKELY = 2.0  # size of a shape in standard deviations from which its bias counts; with a correct model 5 % reach it
CREDIBLE = 3.0  # the same for sensor noise, whose bias does not shrink with the size that is found
SIGNIFICANT = 4.0  # size from which the user is told; by chance it happens once in 16,000 tests
OWN_SHARE = 0.15  # least fraction of the information on a shape that the parameters do not explain as well
CERTAIN = (
    8.0  # size from which a shape of the gear counts without that: parameters take its place, far from their values
)
FAR_MORE = 2.0  # size of a shape over that of another one of its name from which it takes its place
LARGE = 0.5  # change of a positive parameter by such a shape, over its value, from which no interval contains it
MOST = 2  # most shapes that are used together: with more they cancel each other, and their bias grows without limit
TINY = 1e-300
ROUNDING = 1e-12  # range over largest value below which a signal is constant


@dataclass(frozen=True)
class Misfit:
    """Missing torques that were found.

    Attributes:
        found: the shapes, each with its size in standard deviations.
        excess: squares of their bias, to add to the covariance of the coordinates, shape (k, k).
        doubt: why the estimates cannot be used; empty if the intervals contain what is missing.
    """

    found: tuple[tuple[Shape, float], ...]
    excess: Array
    doubt: str = ""

    @property
    def text(self) -> str:
        """The significant shapes in words; empty if none is significant."""
        parts = [f"{s.name} ({size:.3g} sigma: {s.advice})" for s, size in self.found if size > SIGNIFICANT]
        if not parts:
            return ""
        return f"the residuals show {' and '.join(parts)}; the standard deviations contain what that may do"


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
    cross, total, score = _responses(recursion, last, candidates)
    # a shape that is zero everywhere has no scale
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), TINY))
    slope = coordinates.slope(found.z)
    cross = slope[:, None] * cross * scale
    total = scale[:, None] * total * scale
    projected = cross.T @ found.inverse
    M = total - projected @ cross
    a = scale * score - projected @ (slope * last.gradient)
    enough = CREDIBLE * np.sqrt(np.maximum(np.diag(M), 0.0))
    alone = np.abs(a) / np.sqrt(np.maximum(np.diag(M), TINY))
    kept: dict[str, int] = {}  # shapes of one name stand for the same: the first, if another one does not say far more
    for k, shape in enumerate(candidates):
        if shape.sensor and a[k] <= enough[k]:
            continue
        if shape.name not in kept or alone[k] > FAR_MORE * alone[kept[shape.name]]:
            kept[shape.name] = k
    possible = list(kept.values())
    taken: list[int] = []
    sizes: list[float] = []
    for _ in range(min(MOST, len(possible))):
        best, size = _most_significant(candidates, M, a, np.diag(total), possible, taken)
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
        ((sensor, _),) = candidates[k].parts
        level = float(found.levels[len(data.labels) + sensor])
        bias = found.inverse @ attenuation(recursion, coordinates, found, {sensor: level}, last)
        excess += np.outer(bias, bias)
    sized = tuple((candidates[k], size) for k, size in zip(taken, sizes, strict=True))
    certain = [shape.name for shape, size in sized if shape.of_gear and size > CERTAIN]
    doubt = _doubt(recursion, coordinates, found, certain, np.sqrt(np.diag(excess))) if certain else ""
    return Misfit(sized, excess, doubt)


def _doubt(recursion: Recursion, coordinates: Coordinates, found: Minimum, certain: list[str], shift: Array) -> str:
    """Return why shapes of the gear are too large for a bias that is linear in their size, else nothing."""
    name, moved = _most_moved(recursion, coordinates, found, shift)
    if moved < LARGE:
        return ""
    return (
        f"the residuals show {' and '.join(certain)}, which changes {name} by about {100.0 * moved:.0f} %: "
        "too much for a model that lacks it"
    )


def _most_moved(recursion: Recursion, coordinates: Coordinates, found: Minimum, shift: Array) -> tuple[str, float]:
    """Return the positive parameter that a shift of the coordinates (k,) changes most, and by which share of it."""
    data, values = recursion.data, coordinates.values(found.z)
    positive = np.array([data.model.parameter(name).lower >= 0.0 for name in data.free])
    share = np.where(positive, coordinates.slope(found.z) * shift / np.maximum(np.abs(values), TINY), 0.0)
    most = int(np.argmax(share))
    return data.free[most], float(share[most])


def _responses(recursion: Recursion, last: Pass, candidates: Sequence[Shape]) -> tuple[Array, Array, Array]:
    """Return what `Recursion.disturbances` does, for shapes: each is the sum of its parts."""
    parts = [(k, *part) for k, shape in enumerate(candidates) for part in shape.parts]
    sums = np.zeros((len(parts), len(candidates)))
    sums[np.arange(len(parts)), [k for k, _, _ in parts]] = 1.0
    channel = np.array([channel for _, channel, _ in parts], dtype=np.int64)
    cross, total, score = recursion.disturbances(last, channel, np.array([course for _, _, course in parts]).T)
    return cross @ sums, sums.T @ total @ sums, sums.T @ score


def _rightly_named(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, shape: Shape) -> Shape:
    """Return `shape`, noise of the drive's sensor, with the name of what else looks like it if it is that.

    A controller that knows more of the motion than is recorded answers to a disturbance before the filter has seen it.
    Then a drive below the foreseen one goes with a push forwards in the sample before. Noise of a sample has the other
    sign there: what is foreseen for the next sample goes on from it, and it has not moved the joint.
    """
    ((channel, course),) = shape.parts
    before = np.append(course[1:], 0.0)
    cross, _, score = recursion.disturbances(last, np.array([channel]), before[:, None])
    slope = coordinates.slope(found.z)
    if score[0] - (slope * cross[:, 0]) @ found.inverse @ (slope * last.gradient) < 0.0:
        return shape
    name = recursion.data.model.input_names[channel]
    text = f"a recorded {name} that answers to motion which the recorded signals do not show yet"
    return replace(
        shape, name=text, advice="record all sensors that the controller reads, and the drive without a filter"
    )


def _most_significant(
    candidates: Sequence[Shape], M: Array, a: Array, total: Array, possible: list[int], taken: list[int]
) -> tuple[int, float]:
    """Return index and size in standard deviations of the shape that explains most in addition to those taken."""
    rest = [k for k in possible if k not in taken]
    sizes = []
    for k in rest:
        if taken:
            block = np.linalg.solve(M[np.ix_(taken, taken)], np.column_stack([M[taken, k], a[taken]]))
            information, score = M[k, k] - M[k, taken] @ block[:, 0], a[k] - M[k, taken] @ block[:, 1]
        else:
            information, score = M[k, k], a[k]
        size = abs(score) / np.sqrt(information) if information > ROUNDING * total[k] > 0.0 else 0.0
        counts = information > OWN_SHARE * total[k] or (candidates[k].of_gear and size > CERTAIN)
        sizes.append(size if counts else 0.0)
    best = int(np.argmax(sizes))
    return rest[best], float(sizes[best])
