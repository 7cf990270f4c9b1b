"""Friction, rotors and inertial parameters of a whole arm from recordings in which its joints move.

Least squares of all recordings and joints at once, every joint weighted by what it leaves unexplained, with intervals
for residuals that have a memory (Newey & West): see `estimators.regression.covariance`. Every recording has its own
torque offsets; they are taken off as means (Frisch & Waugh).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate, JointValues
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, Equations, equations
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.judged import base_parameters, friction, rotor
from joint_id_core.arm.payload import Factor, Payload, gains_from_mass, payload_of
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked, centred, of_joint
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.results.status import Status

LEAST_R_SQUARED = 0.9  # of the torque of a joint


def fit_arm(
    description: Description,
    records: Sequence[Mapping[str, Recording]],
    gains: Gains,
    held_out: Mapping[str, Recording] | None = None,
    payload: Sequence[Mapping[str, Recording]] = (),
    mass: float | None = None,
) -> ArmEstimate:
    """Fit an arm.

    Args:
        description: of the robot.
        records: recordings, each of all joints by name, with link position, and torque or current.
        gains: by joint and drive ("torque", "current"), the torque at the link in Nm of one unit of it. All masses,
            inertias and torques scale with them.
        held_out: a recording, without payload, that the fit must predict.
        payload: recordings in which the last link carries a payload, the same in all of them.
        mass: of the payload in kg, if it was weighed: the gains are then found, too, from those that are given.

    Raises:
        JointIdError: as `equations`; a payload in all recordings; too little motion for the number of parameters, or
            for the gains.
    """
    if not records:
        raise JointIdError("no recording without a payload: give at least one")
    if mass is not None and not payload:
        raise JointIdError("the mass of a payload tells nothing without a recording in which the arm carries it")
    regressor, source = Regressor(description), description.source
    parts = [equations(regressor, record, gains, source) for record in records]
    parts += [equations(regressor, record, gains, source, loaded=True) for record in payload]
    other = [] if held_out is None else [equations(regressor, held_out, gains, source)]
    factors: tuple[Factor, ...] = ()
    if mass is not None:
        found = zip(*gains_from_mass(parts, mass), strict=True)
        factors = tuple(Factor(n, float(v), float(s)) for n, (v, s) in zip(regressor.joints, found, strict=True))
        scale = np.array([factor.value for factor in factors])
        parts, other = ([replace(part, y=part.y * scale) for part in some] for some in (parts, other))
    fitted = _Fitted(regressor, parts)
    return fitted.estimate(source, fitted.explained(other) if other else None, factors)


class _Fitted:
    """Weighted least squares of all equations."""

    def __init__(self, regressor: Regressor, parts: Sequence[Equations]) -> None:
        self._regressor, self._parts = regressor, parts
        self._count, self._base = len(regressor.joints), len(regressor.reference)
        self._loaded = any(part.loaded for part in parts)
        table = Stacked.of(parts)
        self.values, sigma = table.weighed()
        self.covariance = table.covariance(table.columns, table.y - table.columns @ self.values, sigma)
        self._seen = np.any(table.columns != 0.0, axis=0)

    @property
    def payload(self) -> Payload | None:
        """What the arm carries in some of the recordings; None if in none."""
        if not self._loaded:
            return None
        place = slice(self._base, self._base + PAYLOAD)
        return payload_of(self._regressor.last_link, self.values[place], self.covariance[place, place])

    def explained(self, parts: Sequence[Equations]) -> tuple[float, ...]:
        """Return by joint the share of the torque about its mean that is explained; NaN where a joint does not move."""
        found = []
        for j in range(self._count):
            known = [of_joint(part, j, self._loaded) for part in parts]
            left = np.concatenate([centred(y - columns @ self.values) for y, columns in known])
            spread = float(np.sum(np.concatenate([centred(y) for y, _ in known]) ** 2))
            found.append(1.0 - float(left @ left) / spread if spread > 0.0 else float("nan"))
        return tuple(found)

    def estimate(
        self, source: str, held_out: tuple[float, ...] | None, factors: tuple[Factor, ...] = ()
    ) -> ArmEstimate:
        """Return the result; friction and rotors are known no better than the `factors` on the torques."""
        n, names = self._count, self._regressor.joints
        friction_at = self._base + PAYLOAD * self._loaded
        sigma, share = np.sqrt(np.diag(self.covariance)), [f.std_dev / f.value for f in factors] or [0.0] * n
        r_squared, joints = self.explained(self._parts), []
        for j, name in enumerate(names):
            armature = rotor(self._regressor, j, self.values[j], sigma[j], self._seen[j], share[j])
            lost = [
                friction(float(self.values[k]), sigma[k], unit, bool(self._seen[k]), share[j])
                for k, unit in ((friction_at + j, "Nm s/rad"), (friction_at + n + j, "Nm"))
            ]
            predicted = float("nan") if held_out is None else held_out[j]
            joints.append(JointValues(name, armature, lost[0], lost[1], r_squared[j], predicted))
        parameters = base_parameters(self._regressor, self.values, sigma, self._seen)
        poor = [j.name for j in joints if not j.r_squared > LEAST_R_SQUARED]
        status = Status.POOR_FIT if poor else Status.CONVERGED
        duration = sum(p.duration for p in self._parts)
        doubts = tuple(text for part in self._parts for text in part.doubts)
        return ArmEstimate(source, status, poor, tuple(joints), parameters, duration, self.payload, factors, doubts)
