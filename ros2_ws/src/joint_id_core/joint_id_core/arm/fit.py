"""Friction, rotors and inertial parameters of a whole arm from recordings in which its joints move.

Least squares of all recordings and joints at once, every joint weighted by what it leaves unexplained, with intervals
for residuals that have a memory (Newey & West): see `estimators.regression.covariance`. Every recording has its own
torque offsets; they are taken off as means (Frisch & Waugh).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.arm_estimate import ArmEstimate, BaseParameter, JointValues, Value
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations, equations
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.covariance import automatic_lag, newey_west
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import MAGNITUDE, Verdict

WEIGHINGS = 3  # passes that weigh the joints
LEAST_R_SQUARED = 0.9  # of the torque of a joint
LEAST_ROWS = 2.0  # equations of a joint by parameter
ACCURACY = 1e-3  # of friction at best: the filters blur where it reverses
BOUND = 1.96  # standard deviations below zero from which the data, and not chance, ask for a negative value

Gains = Mapping[str, Mapping[str, float]]


def fit_arm(
    description: Description,
    records: Sequence[Mapping[str, Recording]],
    gains: Gains,
    held_out: Mapping[str, Recording] | None = None,
) -> ArmEstimate:
    """Fit an arm.

    Args:
        description: of the robot.
        records: recordings, each of all joints by name, with link position, and torque or current.
        gains: by joint and drive ("torque", "current"), the torque at the link in Nm of one unit of it. All masses,
            inertias and torques scale with them.
        held_out: a recording that the fit must predict.

    Raises:
        JointIdError: as `equations`, or too little motion for the number of parameters.
    """
    regressor = Regressor(description)
    parts = [equations(regressor, record, gains, description.source) for record in records]
    fitted = _Fitted(regressor, parts)
    other = None if held_out is None else equations(regressor, held_out, gains, description.source)
    predicted = None if other is None else fitted.explained([other])
    return fitted.estimate(description.source, predicted)


class _Fitted:
    """Weighted least squares of all equations."""

    def __init__(self, regressor: Regressor, parts: Sequence[Equations]) -> None:
        self._regressor, self._parts = regressor, parts
        self._count, self._base = len(regressor.joints), len(regressor.reference)
        rows = [(part, j) for part in parts for j in range(self._count)]
        tables = [_of_joint(part, j) for part, j in rows]
        y, columns = (np.concatenate([_centred(pair[i]) for pair in tables]) for i in (0, 1))
        if len(y) < LEAST_ROWS * columns.shape[1]:
            raise JointIdError(
                f"{len(y)} equations are too few for the {columns.shape[1]} parameters of this arm: record longer"
            )
        lengths = [len(pair[0]) for pair in tables]
        joint, pieces = np.repeat([j for _, j in rows], lengths), np.repeat(np.arange(len(rows)), lengths)
        self.values, sigma = self._weighed(y, columns, joint)
        weighted, residuals = columns / sigma[joint, None], (y - columns @ self.values) / sigma[joint]
        scores = weighted * residuals[:, None]
        lags = [automatic_lag(scores[pieces == k][:, np.any(scores[pieces == k], axis=0)]) for k in np.unique(pieces)]
        self.covariance = newey_west(weighted, residuals, pieces, float(np.max(lags)))
        self._seen = np.any(columns != 0.0, axis=0)

    def _weighed(self, y: Array, columns: Array, joint: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return values (P,), and standard deviations of what is left of the torque of each joint, shape (n,)."""
        sigma = np.ones(self._count)
        values = np.zeros(columns.shape[1])
        for _pass in range(WEIGHINGS):
            values = _solved(columns / sigma[joint, None], y / sigma[joint])
            left = y - columns @ values
            counts = np.bincount(joint, minlength=self._count)
            sigma = np.sqrt(np.bincount(joint, left**2, self._count) / np.maximum(counts, 1))
            sigma = np.where(sigma > 0.0, sigma, 1.0)
        return values, sigma

    def explained(self, parts: Sequence[Equations]) -> tuple[float, ...]:
        """Return by joint the share of the torque about its mean that is explained; NaN where a joint does not move."""
        found = []
        for j in range(self._count):
            known = [_of_joint(part, j) for part in parts]
            left = np.concatenate([_centred(y - columns @ self.values) for y, columns in known])
            spread = float(np.sum(np.concatenate([_centred(y) for y, _ in known]) ** 2))
            found.append(1.0 - float(left @ left) / spread if spread > 0.0 else float("nan"))
        return tuple(found)

    def estimate(self, source: str, held_out: tuple[float, ...] | None) -> ArmEstimate:
        """Return the result."""
        n, base, names = self._count, self._base, self._regressor.joints
        sigma = np.sqrt(np.diag(self.covariance))
        r_squared, joints = self.explained(self._parts), []
        for j, name in enumerate(names):
            rotor = self._rotor(j, float(self.values[j] - self._regressor.reference[j]), float(sigma[j]))
            damping, friction = (
                _positive(
                    float(self.values[k]),
                    float(np.hypot(sigma[k], ACCURACY * self.values[k])),
                    unit,
                    bool(self._seen[k]),
                )
                for k, unit in ((base + j, "Nm s/rad"), (base + n + j, "Nm"))
            )
            predicted = float("nan") if held_out is None else held_out[j]
            joints.append(JointValues(name, rotor, damping, friction, r_squared[j], predicted))
        rows = zip(
            self._regressor.combinations, self.values, sigma, self._regressor.reference, self._seen, strict=False
        )
        parameters = tuple(
            BaseParameter(t, float(v), float(s), float(r), _verdict(v, s, r, k)) for t, v, s, r, k in rows
        )
        poor = [j.name for j in joints if not j.r_squared > LEAST_R_SQUARED]
        status = Status.POOR_FIT if poor else Status.CONVERGED
        return ArmEstimate(source, status, poor, tuple(joints), parameters, sum(p.duration for p in self._parts))

    def _rotor(self, j: int, value: float, sigma: float) -> Value:
        """Return the inertia of a rotor seen at the link, beside what the description says of the links."""
        found = _positive(value, sigma, "kg m^2", bool(self._seen[j]))
        return found if self._regressor.alone[j] else found.beside("beside the inertia of its links in the description")


def _of_joint(part: Equations, j: int) -> tuple[Array, Array]:
    """Return torques (T,) and columns (T, P) of the equations of a joint."""
    used = part.used[:, j]
    return part.y[used, j], part.columns[used, j]


def _centred(values: Array) -> Array:
    return values - values.mean(axis=0) if len(values) else values


def _solved(table: Array, y: Array) -> Array:
    """Return least squares; 0 for columns that are zero, and the shortest solution where columns depend."""
    size = np.linalg.norm(table, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    scaled = table / scale  # normal equations, which take a hundredth of the time: base parameters hardly depend
    return np.asarray(np.linalg.lstsq(scaled.T @ scaled, scaled.T @ y, rcond=1e-13)[0] / scale)


def _positive(value: float, sigma: float, unit: str, seen: bool) -> Value:
    """Return a quantity that cannot be negative, with its verdict."""
    if not seen:
        return Value(float("nan"), float("nan"), unit, Verdict.NOT_EXCITED, "the joint does not move")
    if value < -BOUND * sigma:
        told = f"the data pull it below 0, to {value:.3g} ± {sigma:.2g} {unit}"
        return Value(0.0, sigma, unit, Verdict.AT_BOUND, told)
    if sigma > MAGNITUDE * value:
        told = f"it lies below about {max(value, 0.0) + 2.0 * sigma:.2g} {unit}, more is not known"
        return Value(max(value, 0.0), sigma, unit, Verdict.PRIOR, told)
    return Value(value, sigma, unit, Verdict.ESTIMATED, "")


def _verdict(value: float, sigma: float, reference: float, seen: bool) -> Verdict:
    """Return whether a base parameter is known to half of its value, or of that of the description."""
    if not seen:
        return Verdict.NOT_EXCITED
    return Verdict.ESTIMATED if sigma < MAGNITUDE * max(abs(value), abs(reference)) else Verdict.PRIOR
