"""Test the residuals for torques that the model lacks, and add the resulting bias to the covariance.

A score (Lagrange multiplier) test (Breusch & Pagan 1980; Ljung, System Identification, 2nd ed., section 16.5): would
a small torque of a given shape, added to the drive or to the load, explain the residuals? The shapes are those that
joint models most often lack. A missing torque biases the estimates, and the square of this bias is added to their
covariance. This is done for a torque that is likely but not significant, too: a bias that hardly shows in the residuals
may still be large.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.missing_torques import Shape, shapes
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData

LIKELY = 2.0  # size of a shape in standard deviations from which its bias counts; with a correct model 5 % reach it
CREDIBLE = 3.0  # the same for noise of a sensor, whose bias is that of `drive_noise`
SIGNIFICANT = 4.0  # size from which the user is told; by chance it happens once in 16,000 tests
OWN_SHARE = 0.15  # least fraction of the information on a shape that the parameters do not explain as well
CERTAIN = 8.0  # size from which one that parameters take the place of counts without that
FAR_MORE = 2.0  # size of a shape over that of another one of its name, or of any if general, to take its place
# Variation of a torque over that of the drive below which it is contained, but not told: friction that is smoothed,
# where the joint sticks and slips, leaves up to 0.0013 of it in fits of a correct model.
TELLING = 0.002
LARGE = 0.5  # change of the stiffness by such a shape, over its value, from which no interval contains it
MOST = 2  # most shapes that are used together: with more they cancel each other, and their bias grows without limit
TINY = 1e-300
CONTAINED = "the standard deviations contain what that may do"
ROUNDING = 1e-12  # range over largest value below which a signal is constant


@dataclass(frozen=True)
class Misfit:
    """Missing torques that were found.

    Attributes:
        found: the shapes that may be told, each with its size in standard deviations, and with that of its course.
        excess: squares of their bias, to add to the covariance of the coordinates, shape (k, k).
        doubt: why the estimates cannot be used; empty if the intervals contain what is missing.
        lasting: `excess` if a property of joint or drive is significant, which other motion may hide; else None.
        bias: of the coordinates by the shapes that were found, shape (k,), if one of them is such a property and beyond
            doubt; else None.
        of_gain: bias of the coordinates by a gain of the recorded drive that differs by its sign, if it is significant,
            shape (k,). Other estimators read this drive, too.
    """

    found: tuple[tuple[Shape, float, float], ...]
    excess: Array
    doubt: str = ""
    lasting: Array | None = None
    bias: Array | None = None
    of_gain: Array | float = 0.0

    @property
    def text(self) -> str:
        """The significant shapes in words; empty if none is significant."""
        parts = [
            f"{s.name}{_amount(s, course)} ({size:.3g} sigma: {s.advice})"
            for s, size, course in self.found
            if size > _told_from(s)
        ]
        if not parts:
            return ""
        return f"the residuals show {' and '.join(parts)}; {CONTAINED}"


def _told_from(shape: Shape) -> float:
    """Return the size in standard deviations from which the user is told."""
    return SIGNIFICANT * (FAR_MORE if shape.general else 1.0)


def _amount(shape: Shape, course: float) -> str:
    """Return in words how much of a shape there is; empty if that is of no use."""
    if shape.measure is None:
        return ""
    factor, unit = shape.measure
    return f", about {factor * course:.2g} {unit}"


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
    slope = coordinates.slope_at(last.free)
    cross = slope[:, None] * cross * scale
    total = scale[:, None] * total * scale
    projected = cross.T @ found.inverse
    M = total - projected @ cross
    a = scale * score - projected @ (slope * last.gradient)
    test = _Test(candidates, M, a, np.diag(total), found.inverse @ cross)
    possible = test.possible()
    taken = test.select(possible)
    if not taken:
        return none
    together = {frozenset(taken)}
    if replaced := [k for k in taken if candidates[k].replaced]:
        # Together they may cancel each other; and what they took the place of may be there as well.
        together |= {frozenset([k]) for k in replaced}
        together.add(frozenset(test.select([k for k in possible if not candidates[k].replaced])))
    excess = np.zeros_like(found.hessian)
    for some in sorted(together, key=sorted):
        bias = test.bias(some)
        excess += np.outer(bias, bias)
    for k in [k for k in taken if candidates[k].sensor]:
        if taken[k] > SIGNIFICANT:
            candidates[k] = _rightly_named(recursion, coordinates, found, last, candidates[k])
    certain = [candidates[k].name for k in replaced if taken[k] > CERTAIN]
    gains = [k for k in taken if candidates[k].by_sign and taken[k] > _told_from(candidates[k])]
    lasting = excess if gains or any(taken[k] > SIGNIFICANT for k in replaced) else None
    doubt = _doubt(recursion, coordinates, found, certain, np.sqrt(np.diag(excess))) if certain else ""
    courses = test.courses(taken)
    sized = [(candidates[k], size, scale[k] * courses.get(k, 0.0)) for k, size in taken.items()]
    told = tuple((s, size, course) for s, size, course in sized if not _little(data, p, s, course))
    return Misfit(told, excess, doubt, lasting, test.bias(taken) if certain else None, test.bias(gains))


def _little(data: FitData, p: Array, shape: Shape, course: float) -> bool:
    """Return whether a torque of this `course` is so little beside the drive that nobody should look for its cause."""
    model, values = data.model, dict(zip(data.model.parameter_names, p.tolist(), strict=True))
    if shape.sensor or shape.replaced or shape.general or model.torque_drive is None:
        return False
    at_link = model.gear_ratio(values) * model.torque_constant(values)
    load = None if model.load is None else model.input_names.index(model.load)
    drive = float(np.std(data.u[:, model.input_names.index(model.torque_drive)]))
    return all(
        abs(course) * _rms(torque) < TELLING * drive * (at_link if channel == load else 1.0)
        for channel, torque in shape.parts
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class _Test:
    """Scores of the shapes, with what the parameters explain of them taken away.

    Attributes:
        candidates: the shapes, D of them, each scaled to information 1.
        M, a: information (D, D) and score (D,).
        total: information before that was taken away, shape (D,).
        shift: of the coordinates by a shape of size 1, shape (k, D).
    """

    candidates: Sequence[Shape]
    M: Array
    a: Array
    total: Array
    shift: Array

    def possible(self) -> list[int]:
        """Return the shapes that may be taken.

        Noise of a sensor only counts if it is credible, and play or hysteresis if they are not negative. Shapes of one
        name stand for the same thing: it is the first one, if another one does not say far more.
        """
        root = np.sqrt(np.maximum(np.diag(self.M), TINY))
        kept: dict[str, int] = {}
        for k, shape in enumerate(self.candidates):
            if (shape.sensor and self.a[k] <= CREDIBLE * root[k]) or (shape.replaced and self.a[k] <= 0.0):
                continue
            size, before = abs(self.a[k]) / root[k], kept.get(shape.name)
            if before is None or size > FAR_MORE * abs(self.a[before]) / root[before]:
                kept[shape.name] = k
        return list(kept.values())

    def select(self, possible: Sequence[int]) -> dict[int, float]:
        """Return the shapes that are taken, with their sizes in standard deviations, the most significant first."""
        taken: dict[int, float] = {}
        while len(taken) < min(MOST, len(possible)):
            best, size = self._most_significant([k for k in possible if k not in taken], list(taken))
            if size < LIKELY:
                break
            taken[best] = size
        return taken

    def courses(self, taken: Iterable[int]) -> dict[int, float]:
        """Return the sizes of the courses of the torques among the shapes that are taken, as they are scaled."""
        torques = sorted(k for k in taken if not self.candidates[k].sensor)
        sizes = np.linalg.solve(self.M[np.ix_(torques, torques)], self.a[torques])
        return dict(zip(torques, sizes.tolist(), strict=True))

    def bias(self, taken: Iterable[int]) -> Array:
        """Return the bias of the coordinates by the torques among the shapes that are taken, shape (k,)."""
        courses = self.courses(taken)
        return np.asarray(self.shift[:, list(courses)] @ np.array(list(courses.values())))

    def _most_significant(self, rest: Sequence[int], taken: list[int]) -> tuple[int, float]:
        """Return the shape that explains most in addition to those taken, and its size in standard deviations."""
        M, a, sizes = self.M, self.a, list[float]()
        for k in rest:
            information, score = M[k, k], a[k]
            if taken:
                block = np.linalg.solve(M[np.ix_(taken, taken)], np.column_stack([M[taken, k], a[taken]]))
                information, score = information - M[k, taken] @ block[:, 0], score - M[k, taken] @ block[:, 1]
            size = abs(score) / np.sqrt(information) if information > ROUNDING * self.total[k] > 0.0 else 0.0
            own = information > OWN_SHARE * self.total[k] or (self.candidates[k].replaced and size > CERTAIN)
            sizes.append(float(size) if own else 0.0)
        rank = [size / FAR_MORE if self.candidates[k].general else size for k, size in zip(rest, sizes, strict=True)]
        best = int(np.argmax(rank))
        return rest[best], sizes[best]


def _doubt(recursion: Recursion, coordinates: Coordinates, found: Minimum, certain: list[str], shift: Array) -> str:
    """Return why certain shapes are too large for a bias that is linear in their size, else nothing.

    That bias is a `shift` of the coordinates (k,).
    """
    data = recursion.data
    if data.model.stiffness not in data.free:
        return ""
    at = data.free.index(data.model.stiffness)
    moved = coordinates.slope(found.z)[at] * shift[at] / max(float(coordinates.values(found.z)[at]), TINY)
    if moved < LARGE:
        return ""
    return (
        f"the residuals show {' and '.join(certain)}, which changes {data.free[at]} by about {100.0 * moved:.0f} %: "
        "too much for a model that lacks it"
    )


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
    slope = coordinates.slope_at(last.free)
    if score[0] - (slope * cross[:, 0]) @ found.inverse @ (slope * last.gradient) < 0.0:
        return shape
    name = recursion.data.model.input_names[channel]
    text = f"a recorded {name} that answers to motion which the recorded signals do not show yet"
    return replace(
        shape, name=text, advice="record all sensors that the controller reads, and the drive without a filter"
    )
