"""Search for the motion of one joint that tells most of it under its limits.

A candidate is a Fourier series with soft start and end (`fourier`), scaled until a limit is reached: a larger motion of
the same shape tells more. Its worth is that of the standard deviations of a fit (`foresight`), averaged over joints
that are as likely as the one that was described. D- and A-optimality are those of Walter & Pronzato, Identification of
Parametric Models, 1997, ch. 6; `sigma` is the geometric mean of the standard deviations. D-optimal motions may have a
small ellipsoid and large standard deviations, where one bias is in all estimates.

Random shapes come first. The best one then changes in small random steps, as in a (1+1) evolution strategy with a step
that grows after a success (Rechenberg, Evolutionsstrategie, 1973). Most steps are worse for the first joint already,
and the others are not asked, which leaves time for more steps. The worth has many local minima, and is too rough for
gradients: where a joint sticks at a reversal, a little more motion changes much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.design.criterion import require_criterion
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.fourier import FourierMotion, basis
from joint_id_core.design.limits import JointLimits
from joint_id_core.errors import JointIdError
from joint_id_core.options import Progress

TONES = 6
LOWEST_PERIODS, HIGHEST_HZ = 2.0, 6.0  # tones: from so many periods in the motion up to this frequency
ABOVE = 2.0  # nor above so many times that of the sine that reaches the limits of acceleration and jerk at once
STEEPEST = 3.0  # amplitudes of random shapes fall with up to this power of the frequency
SHAPES, STEPS = 20, 56  # random shapes, and steps from the best one
PAIRS = 1  # pairs of other joints over which the worth is averaged
FIRST_STEP, LEAST_STEP, MORE, LESS = 0.4, 0.05, 1.5, 0.9  # of the changes, relative to the amplitudes
MARGIN = 0.995  # of the limits that is used: between samples a motion may go a little further
RAMP_S, RAMP_SHARE = 1.0, 0.25  # soft start and end: so long, and at most this share of the motion
TORQUE_TRIES = 3  # times that a motion is made smaller because of its torque


@dataclass(frozen=True)
class Shape:
    """Frequencies in Hz, shape (tones,), and amplitudes of their cosines and sines, (2, tones), up to a scale."""

    frequencies: Array
    waves: Array


@dataclass(frozen=True)
class Candidate:
    """A motion within the limits, and its worth for each joint that was asked: less is better.

    `held` says which limit holds it, as a word of `limits.UNITS`.
    """

    shape: Shape
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
        limits: of this joint alone, without infinite ones but for the torque.
        home: position at the start and end in rad.
        duration: of the motion in s.
        names: of the parameters that it is to show.
        criterion: "D" or "A".

    Raises:
        JointIdError: the motion is too short, the joint is not within its limits at home, an unknown parameter.
    """

    def __init__(
        self,
        foresight: Foresight,
        limits: JointLimits,
        home: float,
        duration: float,
        names: Sequence[str],
        criterion: str = "sigma",
    ) -> None:
        require_criterion(criterion)
        self.foresight, self.limits, self.home, self.duration = foresight, limits, home, duration
        for name in names:
            foresight.model.parameter(name)
            if name not in foresight.free:
                raise JointIdError(f"parameter {name} is held: free it (--free {name}), or ask for others")
        if not limits.lower[0] < home < limits.upper[0]:
            raise JointIdError(
                f"home = {home:g} rad is not between the limits {limits.lower[0]:g} and {limits.upper[0]:g} rad"
            )
        self.criterion, self.joints = criterion, foresight.joints(PAIRS)
        self._columns: NDArray[np.int64] = np.array([foresight.free.index(name) for name in names], dtype=np.int64)
        self.highest = min(HIGHEST_HZ, ABOVE * float(limits.jerk[0] / limits.acceleration[0]) / (2.0 * math.pi))
        self.ramp = min(RAMP_S, RAMP_SHARE * duration)
        self._strained = math.inf  # least torque in Nm of motions that break its limit
        self.time = np.arange(round(duration * foresight.rate) + 1) / foresight.rate

    def run(self, progress: Progress = lambda _: None) -> Candidate:
        """Search; the same arguments give the same motion.

        Raises:
            JointIdError: no motion within the limits can be fitted.
        """
        rng, best = np.random.default_rng(0), None
        for k in range(SHAPES):
            progress(f"motion {k + 1} of {SHAPES + STEPS}")
            best = self._better(self._random(rng), best, 1)
        if best is None:
            raise JointIdError(self._none())
        best = self._better(best.shape, None, len(self.joints)) or best
        size = FIRST_STEP
        for k in range(STEPS):
            progress(f"motion {SHAPES + k + 1} of {SHAPES + STEPS}")
            found = self._better(self._changed(best.shape, size, rng), best, len(self.joints))
            size = min(1.0, size * MORE) if found is not best else max(LEAST_STEP, size * LESS)
            best = found or best
        return best

    def motion(self, candidate: Candidate, name: str) -> FourierMotion:
        """Return the motion of a candidate, of the joint with this name."""
        cosines, sines = candidate.scale * candidate.shape.waves
        frequencies = candidate.shape.frequencies
        return FourierMotion(
            (name,), np.array([self.home]), cosines[None], sines[None], frequencies, self.duration, self.ramp
        )

    def candidate(self, shape: Shape) -> Candidate | None:
        """Return a shape within the limits with its worth for the first joint; None if it cannot be fitted."""
        return self._better(shape, None, 1)

    def moved(self, shape: Shape) -> Array:
        """Return position, velocity, acceleration and jerk of a shape, (4, T)."""
        return np.asarray(basis(self.time, shape.frequencies, self.duration, self.ramp) @ shape.waves.ravel())

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

    def _better(self, shape: Shape, best: Candidate | None, joints: int) -> Candidate | None:
        """Return the shape as a candidate if it is better than the best one, by so many joints, else the best one."""
        moved = self.moved(shape)
        scale, held = self._scaled(moved)
        if not math.isfinite(scale):
            return best
        allowed = float(self.limits.torque[0]) * MARGIN
        for _ in range(TORQUE_TRIES):
            seen = list[tuple[float, float]]()
            for joint in self.joints[:joints]:
                seen.append(self._worth(joint, scale * moved))
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

    def _scaled(self, moved: Array) -> tuple[float, str]:
        """Return the largest scale within the limits but the torque's, and which one holds it; infinite without one."""
        own, room = self.limits, {}
        up, down = float(moved[0].max()), -float(moved[0].min())
        above, below = float(own.upper[0]) - self.home, self.home - float(own.lower[0])
        room["position"] = min(above / up if up > 0.0 else math.inf, below / down if down > 0.0 else math.inf)
        for kind, values in zip(("velocity", "acceleration", "jerk"), moved[1:], strict=True):
            size = float(np.abs(values).max())
            room[kind] = float(getattr(own, kind)[0]) / size if size > 0.0 else math.inf
        held = min(room, key=lambda kind: room[kind])
        return MARGIN * room[held], held

    def _worth(self, joint: dict[str, float], moved: Array) -> tuple[float, float]:
        """Return the worth of a motion (4, T) for one joint and its largest torque; infinite if it cannot be fitted."""
        try:
            seen = self.foresight.see(joint, self.home + moved[0], moved[1])
        except JointIdError:
            return math.inf, 0.0
        return worth(seen.covariance, self._columns, self.foresight.coordinates.unit, self.criterion), seen.torque

    def _random(self, rng: np.random.Generator) -> Shape:
        low = min(LOWEST_PERIODS / self.duration, 0.5 * self.highest)
        frequencies = np.exp(rng.uniform(math.log(low), math.log(self.highest), TONES))
        return Shape(frequencies, rng.standard_normal((2, TONES)) * frequencies ** -rng.uniform(0.0, STEEPEST))

    def _changed(self, shape: Shape, size: float, rng: np.random.Generator) -> Shape:
        """Return a shape with some tones changed; a weak tone may become as strong, in acceleration, as others."""
        low = 1.0 / self.duration
        some = rng.random((3, TONES)) < 0.5
        frequencies = shape.frequencies * np.exp(0.5 * size * some[0] * rng.standard_normal(TONES))
        frequencies = np.clip(frequencies, low, self.highest)
        strength = np.hypot(*shape.waves)
        least = 0.1 * np.max(strength * shape.frequencies**2) / shape.frequencies**2
        waves = shape.waves + size * some[1:] * rng.standard_normal((2, TONES)) * np.maximum(strength, least)
        return Shape(frequencies, waves)


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
