"""Search for the motion of one joint that tells most of it under its limits.

What may move is a kind of shapes: Fourier series (`fourier_shapes`), or ways through waypoints (`waypoint_shapes`). The
worth of a motion is that of the standard deviations of a fit (`foresight`), averaged over joints that are as likely as
the one that was described. D- and A-optimality are those of Walter & Pronzato, Identification of Parametric Models,
1997, ch. 6; `sigma` is the geometric mean of the standard deviations. D-optimal motions may have a small ellipsoid and
large standard deviations, where one bias is in all estimates.

Random shapes come first, then steps from the best one (`evolution`). Most steps are worse for the first joint already,
and the others are not asked, which leaves time for more steps. The worth has many local minima, and is too rough for
gradients: where a joint sticks at a reversal, a little more motion changes much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.design.criterion import require_criterion
from joint_id_core.design.evolution import Kind, drawn, evolved
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.options import Progress

SHAPES, STEPS = 20, 56  # random shapes, and steps from the best one
PAIRS = 1  # pairs of other joints over which the worth is averaged
MARGIN = 0.995  # of the limits that is used: between samples a motion may go a little further
TORQUE_TRIES = 3  # times that a motion is made smaller because of its torque


@dataclass(frozen=True)
class Sized:
    """A shape within all limits but that of the torque.

    Attributes:
        at: returns position and velocity (T,), in rad and rad/s, at a scale; it raises a JointIdError where a shape
            cannot be made so small.
        scale: the largest one.
        held: which limit holds it, as a word of `limits.UNITS`.
    """

    at: Callable[[float], tuple[Array, Array]]
    scale: float
    held: str


class Shapes(Kind[Any], Protocol):
    """A kind of shapes of the motion of one joint."""

    def sized(self, shape: Any) -> Sized | None:
        """Return a shape within the limits but that of the torque; None if nothing moves."""

    def trajectory(self, shape: Any, scale: float, name: str) -> Trajectory:
        """Return the motion, of the joint with this name."""

    def told(self, shape: Any, scale: float) -> tuple[str, ...]:
        """Return as sentences what there is to say of the motion."""

    def beyond(self, shape: Any, scale: float) -> tuple[Array, Array] | None:
        """Return position and velocity (T,) of the motion, larger than any limit allows; None if there is no such."""


@dataclass(frozen=True)
class Candidate:
    """A motion within the limits, and its worth for each joint that was asked: less is better.

    `held` says which limit holds it, as a word of `limits.UNITS`.
    """

    shape: Any
    scale: float
    worths: tuple[float, ...]
    held: str

    @property
    def worth(self) -> float:
        """Mean over the joints."""
        return float(np.mean(self.worths))


class Search:
    """Search for the motion of one joint.

    Args:
        foresight: what motions tell of it.
        shapes: among which it is.
        limits: of this joint alone; that of its torque is held here, the others by the shapes.
        duration: of the motions in s.
        names: of the parameters that it is to show.
        criterion: "sigma", "D" or "A".

    Raises:
        JointIdError: an unknown parameter or criterion.
    """

    def __init__(
        self,
        foresight: Foresight,
        shapes: Shapes,
        limits: JointLimits,
        duration: float,
        names: Sequence[str],
        criterion: str = "sigma",
    ) -> None:
        require_criterion(criterion)
        self.foresight, self.shapes, self.limits, self.duration = foresight, shapes, limits, duration
        for name in names:
            foresight.model.parameter(name)
            if name not in foresight.free:
                raise JointIdError(f"parameter {name} is held: free it (--free {name}), or ask for others")
        self.criterion, self.joints = criterion, foresight.joints(PAIRS)
        self._columns: NDArray[np.int64] = np.array([foresight.free.index(name) for name in names], dtype=np.int64)
        self._strained = math.inf  # least torque in Nm of motions that break its limit

    def run(self, progress: Progress = lambda _: None) -> Candidate:
        """Search; the same arguments give the same motion.

        Raises:
            JointIdError: no motion within the limits can be fitted.
        """
        rng, every = np.random.default_rng(0), len(self.joints)

        def tell(k: str, before: int = 0) -> None:
            progress(f"motion {int(k) + before} of {SHAPES + STEPS}")

        best = drawn(self.shapes, lambda shape, best: self._better(shape, best, 1), SHAPES, rng, tell)
        if best is None:
            raise JointIdError(self._none())
        best = self._better(best.shape, None, every) or best
        return evolved(
            self.shapes, best, lambda shape, best: self._better(shape, best, every) or best, STEPS, rng,
            lambda k: tell(k, SHAPES),
        )  # fmt: skip

    def trajectory(self, candidate: Candidate, name: str) -> Trajectory:
        """Return the motion of a candidate, of the joint with this name."""
        return self.shapes.trajectory(candidate.shape, candidate.scale, name)

    def candidate(self, shape: Any) -> Candidate | None:
        """Return a shape within the limits with its worth for the first joint; None if it cannot be fitted."""
        return self._better(shape, None, 1)

    def _none(self) -> str:
        """Return why no motion was found."""
        what = f"no motion of {self.duration:g} s within the limits moves the joint enough for a fit: "
        if math.isfinite(self._strained):
            return (
                f"{what}larger ones take {self._strained:.3g} Nm or more at the link, and the limit of "
                f"torque is {self.limits.torque[0]:g} Nm ({self.limits.source}): give a higher one, or what the joint "
                "has of friction and inertia (--set)"
            )
        return f"{what}give more time or wider limits ({self.limits.source})"

    def _better(self, shape: Any, best: Candidate | None, joints: int) -> Candidate | None:
        """Return the shape as a candidate if it is better than the best one, by so many joints, else the best one."""
        sized = self.shapes.sized(shape)
        if sized is None:
            return best
        scale, held = sized.scale, sized.held
        allowed = float(self.limits.torque[0]) * MARGIN
        for _ in range(TORQUE_TRIES):
            seen = list[tuple[float, float]]()
            for joint in self.joints[:joints]:
                seen.append(self._worth(joint, sized, scale))
                worths = tuple(one[0] for one in seen)
                if best is not None and np.mean(worths) >= np.mean(best.worths[: len(worths)]):
                    return best  # the other joints are not asked
            torque = max(one[1] for one in seen)
            if torque <= allowed:
                break
            self._strained = min(self._strained, torque)
            scale, held = 0.95 * scale * allowed / torque, "torque"
        else:
            return best
        return Candidate(shape, scale, worths, held) if all(map(math.isfinite, worths)) else best

    def _worth(self, joint: dict[str, float], sized: Sized, scale: float) -> tuple[float, float]:
        """Return the worth of a motion for one joint and its largest torque; infinite if it cannot be fitted."""
        try:
            seen = self.foresight.see(joint, *sized.at(scale))
        except JointIdError:
            return math.inf, 0.0
        return worth(seen.covariance, self._columns, self.foresight.coordinates.unit, self.criterion), seen.torque


def worth(covariance: Array, columns: NDArray[np.int64], unit: Array, criterion: str) -> float:
    """Return the worth of a covariance (k, k) of the coordinates: less is better.

    D: half the logarithm of the determinant of the block of `columns`; A: half the logarithm of its trace, each
    coordinate in its `unit` (k,).
    """
    block = (covariance / np.outer(unit, unit))[np.ix_(columns, columns)]
    if criterion == "sigma":
        return 0.5 * float(np.sum(np.log(np.diag(block))))
    if criterion == "A":
        return 0.5 * math.log(float(np.trace(block)))
    sign, size = np.linalg.slogdet(block)
    return 0.5 * float(size) if sign > 0.0 else math.inf
