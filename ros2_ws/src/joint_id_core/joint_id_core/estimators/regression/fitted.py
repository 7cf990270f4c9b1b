"""The solution of an equation, and what tells whether it is that of the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.shift import Shift
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.encoder_lag import Lag
from joint_id_core.estimators.regression.lacking import CONTAINED, with_late_drive
from joint_id_core.estimators.regression.lag import when
from joint_id_core.estimators.regression.least_squares import (
    HeldOut,
    Solution,
    explained,
)
from joint_id_core.estimators.regression.missing import (
    GRAVITY,
    HELPS,
)
from joint_id_core.estimators.regression.samples import Samples
from joint_id_core.estimators.regression.share import Share

LEAST_R_SQUARED = 0.5  # below, the equation is not that of this motion
# The same for samples that were not fitted, if the residuals have a memory (noise may leave less). On a UR10e, joints
# that the others hardly load have 0.96 to 0.999, those that they load, and whose values are wrong, -0.4 to 0.8.
LEAST_HELD_OUT = 0.9
REMEMBERED = 0.3  # autocorrelation after a period of the band, from which residuals are no noise of sensors
MOST_GRAVITY = 0.5  # share of what is left that a load with the angle explains, from which the model is a wrong one
# A drive that is held between samples acts half a sample later than a measured one. Where friction or load are not
# what the model says, a wrong shift leaves 76 % and more on a UR10e, and 30 % on an axis of a KUKA. Of true lags that
# matter, simulated or put into the EMPS benchmark, it leaves less than 2 %.
LATE = 0.75  # samples
LEFT = 0.2  # share of what is left unexplained, which is left with the best shift
DOUBTED = 0.5  # the same from which intervals contain the values of this shift
SURELY = 4.0  # standard deviations below zero, from which the sign of the drive is wrong
SHIFTED = "against the motion: shifted by this"  # of a note about a drive that is late or early
TOLD = 0.05  # half of the difference between the halves of a recording, over the value, from which the user is told
TINY = 1e-300
LITTLE = 0.005  # share of the torque that may be left unexplained, whatever would explain it


@dataclass(frozen=True)
class Fitted:
    """An equation and its solution.

    Attributes:
        gravity: share of what it leaves unexplained that gravity would explain, if the model has none.
        held_out: see `least_squares.explained_later`.
        memory: autocorrelation of the residuals after one period of the band.
        helps: share of the error of samples that were not fitted that a torque which the model lacks takes away, by the
            option that adds it.
        late: by how many s the drive is late against the motion; None if it cannot be told.
        share: by how much of a sample the drive comes late beside all parameters; None if it cannot be told.
        encoders: how late the link's encoder is; None without motion on both sides of the gear.
        positive: True for parameters that cannot be negative, shape (k,).
        gear: True for stiffnesses of a gear with motion on both sides, shape (k,).
    """

    samples: Samples
    solution: Solution
    gravity: float
    held_out: HeldOut
    memory: float
    helps: Mapping[str, float]
    late: Shift | None
    share: Share | None = None
    encoders: Lag | None = None
    positive: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    gear: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.samples.equation.names

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters, and last of the lag between the encoders if it is one of them."""
        encoders, known = self.encoders, self.solution.covariance
        if encoders is None or encoders.name is None:
            return known
        cross = encoders.sigma * encoders.effect[:, None]
        return np.block([[known, cross], [cross.T, np.array([[encoders.sigma**2]])]])

    def with_delay_in_doubt(self, taken: bool) -> Fitted:
        """Return it with intervals that contain what is not known of a late drive; `taken` as of `Share.doubt`."""
        if self.late is not None and self._may_be_late:
            samples, beside_turn = self.samples, len(self.late.factors) > len(self.names)
            y, columns = samples.y, samples.with_turn if beside_turn else samples.columns
            solution = with_late_drive(self.solution, self.late, y[samples.fast], columns[samples.fast])
            return replace(self, solution=solution)
        if self.share is None or not self.samples.equation.factor:
            return self
        doubt, found = self.share.doubt(taken), self.solution
        covariance = found.covariance + np.outer(doubt, doubt)
        return replace(self, solution=replace(found, covariance=covariance, doubt=np.hypot(found.doubt, doubt)))

    @property
    def changed(self) -> list[tuple[str, float, float]]:
        """Parameters that differ most between the halves of the recording, at most two, with their values in both."""
        changes = np.broadcast_to(self.solution.changes, len(self.names))
        halves = np.broadcast_to(self.solution.halves, (2, len(self.names)))
        size = changes / np.maximum(np.abs(self.solution.values), TINY)
        order = [int(k) for k in np.argsort(-size)[:2] if size[k] > TOLD]
        return [(self.names[k], float(halves[0, k]), float(halves[1, k])) for k in order]

    @property
    def opposite(self) -> float:
        """Share that is explained by negative inertia and friction; 0 if one of them is not surely negative."""
        found, equation = self.solution, self.samples.equation
        seen, surely = self.positive & ~found.unseen, found.unbounded < -SURELY * found.sigma
        inertia = np.array([n == equation.inertia for n in equation.names])
        if not (surely & inertia).any() or not (found.unbounded[seen] < 0.0).all():
            return 0.0
        return explained(self.samples.y, self.samples.columns @ np.nan_to_num(found.unbounded))

    @property
    def shifted(self) -> bool:
        """Whether the drive is late or early by more than one can be that changes between samples."""
        return self.late is not None and self.late.sure and abs(self.late.late) >= LATE * self.samples.period

    @property
    def _left(self) -> float:
        """Share of what is left unexplained, which is left with the best shift of the drive."""
        late = self.late
        return (1.0 - late.explained) / (1.0 - late.before) if late is not None and late.before < 1.0 else 1.0

    @property
    def _may_be_late(self) -> bool:
        return self.samples.tools is None and self.shifted and self._left < DOUBTED

    @property
    def lag(self) -> str:
        """How late or early the drive is against the motion; empty if it is not, or cannot be told."""
        late = self.late
        if late is None or not self.shifted:
            return ""
        if late.explained < LEAST_R_SQUARED or self._left > LEFT:
            return ""
        shares = f"{percent(late.explained)} of the torque are explained, as recorded {percent(late.before)}"
        return f"the drive seems to be {when(late)} {SHIFTED}, {shares}; correct its times"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why intervals are wide, as clauses."""
        reasons = self.solution.reasons
        if self.late is None or not self._may_be_late or self.lag:
            return reasons
        return (*reasons, f"the drive may be {when(self.late)} against the motion; {CONTAINED}")

    @property
    def blind(self) -> bool:
        """Whether the torque of the gear is missing, as its instruments do not show it.

        Inertia and friction of the motor then contain those of the link.
        """
        return bool(self.gear.any() and self.solution.unseen[self.gear].all())

    @property
    def _explains(self) -> bool:
        return self.solution.r_squared > LEAST_R_SQUARED

    @property
    def fault(self) -> str:
        """Why the equation is not that of the motion; empty if it is."""
        left = "of what the model does not explain"
        encoders = self.encoders
        if encoders is not None and encoders.name is None and encoders.sure and self.solution.held.any():
            when = f"{1e3 * abs(encoders.late):.3g} ms {'late' if encoders.late > 0.0 else 'early'}"
            return (
                f"the link's encoder seems to be {when} against the motor's, which looks like viscous friction: take a "
                "model with delays (--delays), or correct its times"
            )
        quantity = self.samples.equation.quantity
        if self.opposite > LEAST_R_SQUARED:
            return (
                f"the {quantity} acts against the motion: with the opposite sign {percent(self.opposite)} of it are "
                "explained; change the sign of its column or of the positions (--map torque=-1*COLUMN)"
            )
        if not self._explains:
            return f"only {percent(self.solution.r_squared)} of the {quantity} are explained"
        # over the angles of a single move, cos and sin follow anything: they must predict as well
        loaded = self.gravity > MOST_GRAVITY and self.helps.get(GRAVITY, 0.0) > HELPS
        if loaded and 1.0 - self.solution.r_squared > LITTLE:
            angle = f"a load that depends on the angle explains {100.0 * self.gravity:.2g} % {left}"
            return f"{angle}: take a model with gravity ({GRAVITY})"
        # With the motion of the link as an input no load is lacking, and noise of the twist enters what is predicted.
        least = LEAST_HELD_OUT if self.encoders is None else LEAST_R_SQUARED
        if self.held_out.at_best < least and self.memory > REMEMBERED:
            lacking = (
                "and masses of the description or torque constants may be wrong (joint-id arm fit --out writes a "
                "description that matches)"
                if self.samples.loaded
                else "such as that of other joints that move (give the robot's description, --urdf, or move one joint "
                "at a time)"
            )
            return (
                f"friction and inertia of the first part of the recording explain {percent(self.held_out.share)} of "
                f"their torque in the rest: a load acts on the joint that the model lacks, {lacking}"
            )
        return ""


def percent(share: float) -> str:
    """Return a share in words, at least zero."""
    return f"{100.0 * max(0.0, share):.3g} %"
