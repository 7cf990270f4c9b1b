"""Friction, rotors and inertial parameters of a whole arm from recordings in which its joints move.

Least squares of all recordings and joints at once, every joint weighted by what it leaves unexplained, with intervals
for residuals that have a memory (Newey & West): see `estimators.regression.covariance`. Every recording has its own
torque offsets; they are taken off as means (Frisch & Waugh).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate, JointValues, Rest, Value
from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.description import Description
from joint_id_core.arm.drift import drift
from joint_id_core.arm.equations import PAYLOAD, Equations, equations
from joint_id_core.arm.friction import STRAIGHT, UNEVEN, Friction, shows_bend
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.gear import with_yielding
from joint_id_core.arm.gravity import check_gravity
from joint_id_core.arm.judged import base_parameters, beside_bodies, friction, rotor
from joint_id_core.arm.links import consistent_links
from joint_id_core.arm.motion import require_still
from joint_id_core.arm.noise import noise_of
from joint_id_core.arm.payload import Factor, Payload, gains_from_mass, payload_of
from joint_id_core.arm.recorded_otherwise import recorded_otherwise
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.rests import LEAST_R_SQUARED, Band, HeldOut, Left, explained
from joint_id_core.arm.stacked import Stacked, free
from joint_id_core.arm.suspects import suspects
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import Verdict

WORSE = 2.0  # what is left of a held-out recording over what is left of those that were fitted
ROUNDS = 2  # of torque constants: the first has the load of the gears with wrong ones
BENT = 0.1  # least bend of friction, as a share of Coulomb friction: a smaller one is that of the filters at reversals
SURE = 3.0  # standard deviations from which a bend of friction, or its growth with the load, is taken into the law


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
        JointIdError: as `equations`; a payload in all recordings; gravity acts elsewhere; too little motion for the
            number of parameters, or for the gains.
    """
    if not records:
        raise JointIdError("no recording without a payload: give at least one")
    if mass is not None and not payload:
        raise JointIdError(
            "the mass of a payload tells nothing without a recording in which the arm carries it: give one (--payload)"
        )
    regressor, source = Regressor(description), description.source
    for record in (*records, *payload, *([] if held_out is None else [held_out])):
        require_still(record, description.still)
    parts = [equations(regressor, record, gains, source) for record in records]
    check_gravity(description, regressor, parts)
    parts += [equations(regressor, record, gains, source, loaded=True) for record in payload]
    other = [] if held_out is None else [equations(regressor, held_out, gains, source)]
    factors: tuple[Factor, ...] = ()
    if mass is not None:
        found = zip(*_gains(regressor, parts, mass), strict=True)
        factors = tuple(Factor(n, float(v), float(s)) for n, (v, s) in zip(regressor.joints, found, strict=True))
        scale = np.array([factor.value for factor in factors])
        parts, other = ([part.scaled(scale) for part in some] for some in (parts, other))
    fitted = _Fitted(description, regressor, parts, [f.std_dev / f.value if f.known else 0.0 for f in factors])
    told = fitted.estimate(source, fitted.held_out(other[0]) if other else None, factors)
    return replace(told, recordings=tuple(record[regressor.joints[0]].source for record in (*records, *payload)))


def _gains(regressor: Regressor, parts: Sequence[Equations], mass: float) -> tuple[Array, Array]:
    """Return factors on the torques of all joints with which the payload has this mass, and their sigma, shape (n,)."""
    scale, sigma = np.ones(len(regressor.joints)), np.zeros(len(regressor.joints))
    beforehand = Beforehand.of(regressor)
    for _ in range(ROUNDS):
        scaled = [part.scaled(scale) for part in parts]
        law = Friction.from_values(regressor, Stacked.of(scaled, beforehand).weighed()[0])
        complete = [law.added(part) for part in scaled]
        found, spread = gains_from_mass(complete, mass, beforehand)
        scale, sigma = scale * found, scale * spread
    growth = float(Stacked.of(complete, beforehand).weighed()[0][-1])
    return scale, np.hypot(sigma, UNEVEN * max(0.0, growth) * scale)


class _Fitted:
    """Weighted least squares of all equations."""

    def __init__(
        self, description: Description, regressor: Regressor, parts: Sequence[Equations], gains: Sequence[float]
    ) -> None:
        """Fit; `gains` are standard deviations of the gains, as shares of them, or none."""
        self._regressor, self._beforehand = regressor, Beforehand.of(regressor)
        self._count, self._base = len(regressor.joints), len(regressor.reference)
        self._loaded = any(part.loaded for part in parts)
        self._friction = Friction.from_values(regressor, self._whole(Stacked.of(parts, self._beforehand).weighed()[0]))
        self._parts = [self._friction.added(part) for part in parts]
        self.covariance: Array
        self._lag: float
        self._friction_at = self._base + PAYLOAD * self._loaded
        table = self._with_what_data_ask_for(Stacked.of(self._parts, self._beforehand))
        places = (self._friction_at + np.arange(2 * self._count)).reshape(2, -1)
        left = table.y - table.columns @ self.values
        # a fit takes some of the noise for motion
        whole = left / np.sqrt(free(table.columns / table.scatter(left)[table.joint][:, None]))
        self._noise = [noise_of(whole[table.joint == j], self._lag) for j in range(self._count)]
        changes = drift(table, left, places, self.values[places], self._lag)
        self.covariance = with_yielding(self.values, self.covariance, self._friction_at + self._friction.gears)
        self.covariance[places, places] += (changes[:, None] * self.values[places]) ** 2 / len(parts)
        uneven = np.zeros(len(self.values))
        loads = len(self._friction.rigid) if self._loaded else self._base
        uneven[:loads] = self._friction.as_load(float(self.values[-1]))[:loads]
        self._uneven = np.outer(uneven, uneven)
        self.covariance += self._uneven
        found = suspects(description, self._parts, table, self.values, self._whole(self.values), self._lag)
        self.covariance += found.excess + found.usual
        self._suspects = found
        empty = [part for part in self._parts if not part.loaded]
        self._mistaken = recorded_otherwise(description, regressor, empty, self._beforehand)
        if gains:
            moved = table.by_gain(table.scatter(left)) * np.array(gains)
            self.covariance += moved @ moved.T
        self._lefts = [self._left(part) for part in self._parts]
        self._band = Band.of(self._lefts)

    def _with_what_data_ask_for(self, table: Stacked) -> Stacked:
        """Solve, again without bends and growth with the load that may be 0, and return the equations of that.

        Where no motion tells a bend from a straight line, the law is that line, and intervals contain both.
        """
        self._solve(table)
        more = self._friction_at + self._friction.bends_and_growth
        size, sigma = np.abs(self.values[more]), np.sqrt(np.maximum(np.diag(self.covariance), 0.0))[more]
        self._by_load = float(self.values[-1]), float(sigma[-1])
        size[-1] = self.values[-1]  # friction does not fall with the load
        coulomb = np.abs(self.values[self._friction_at + self._count : more[0]])
        sure = size > np.maximum(SURE * sigma, np.append(BENT * coulomb, 0.0))
        slow = ~np.append(np.any([shows_bend(part) for part in self._parts], axis=0), True)
        names = self._regressor.joints
        self._slow = [name for name, own in zip(names, sure & slow, strict=False) if own]
        if np.any(weak := ~sure & ~slow):
            table = table.without(more[weak])
            self._solve(table)
        if slow.any():
            table, bent = table.without(more[slow]), self.values
            self._solve(table)
            self.covariance += np.outer(bent - self.values, bent - self.values)
        return table

    def _solve(self, table: Stacked) -> None:
        """Find values, their covariance, and the lag in equations over which residuals remember."""
        self.values, sigma = table.weighed()
        left = table.y - table.columns @ self.values
        self.covariance, self._lag = table.covariance(table.columns, left, sigma, table.precision)
        self._seen = np.any(table.columns != 0.0, axis=0)

    def _whole(self, values: Array) -> Array:
        """Return values with those of a payload, which are 0 where there is none."""
        return values if self._loaded else np.insert(values, self._base, np.zeros(PAYLOAD))

    def _left(self, part: Equations) -> Left:
        return Left.of(part, self._friction, self._whole(self.values))

    @property
    def payload(self) -> Payload | None:
        """What the arm carries in some of the recordings; None if in none."""
        if not self._loaded:
            return None
        place = slice(self._base, self._base + PAYLOAD)
        return payload_of(self._regressor.last_link, self.values[place], self.covariance[place, place])

    def held_out(self, part: Equations) -> HeldOut:
        """Return how another recording is predicted."""
        left = self._left(self._friction.added(part))
        return HeldOut(explained([left]), self._band.holds(left), left.rests.mean(axis=0), self._band.worse(left))

    def estimate(self, source: str, held_out: HeldOut | None, factors: tuple[Factor, ...] = ()) -> ArmEstimate:
        """Return the result, with `factors` on the torques that it has already."""
        n = self._count
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))  # of what nothing shows, rounding is left
        r_squared, usual = explained(self._lefts), self._friction.usual
        bands = self._band.width(self._friction.breakaway(self.values[self._friction_at :], usual))
        other, joints = held_out or HeldOut(*np.full((4, n), np.nan)), []
        for j, name in enumerate(self._regressor.joints):
            armature = rotor(self._regressor, j, self.values[j], sigma[j], self._seen[j])
            damping, coulomb = (
                friction(float(self.values[k]), sigma[k], unit, bool(self._seen[k]))
                for k, unit in ((self._friction_at + j, "Nm s/rad"), (self._friction_at + n + j, "Nm"))
            )
            rest = Rest(*(float(a[j]) for a in (bands, self._band.rest_s, other.in_band, other.resting)))
            bent = float(self.values[self._friction_at + 2 * n + j])
            told = float(r_squared[j]), float(other.r_squared[j]), float(usual[j]), bent
            joints.append(JointValues(name, armature, damping, coulomb, *told, rest, self._noise[j]))
        parameters = base_parameters(self._regressor, self.values, sigma, self._seen, self._beforehand.sigma)
        rotors = [j.armature.value if j.armature.verdict is Verdict.ESTIMATED else 0.0 for j in joints]
        base, seen = self._base, self._seen[: self._base]
        # Files shall have the torques that were recorded: what of them is friction of the gears is left in.
        known = (self.covariance - self._uneven)[:base, :base] * np.outer(seen, seen)
        links = consistent_links(self._regressor, self.values[:base], known, rotors)
        joints = [
            replace(joint, armature=beside_bodies(joint.armature, link.rotor))
            for joint, link in zip(joints, links.links, strict=True)
        ]
        poor = [j.name for j in joints if j.r_squared <= LEAST_R_SQUARED or j.pulled_below_zero]
        missed = [
            j.name for j, w in zip(joints, other.worse, strict=True) if j.held_out <= LEAST_R_SQUARED and w > WORSE
        ]
        contradiction = self._suspects.gross or links.contradiction
        wrong = poor or missed or contradiction or self._mistaken
        status = Status.POOR_FIT if wrong else Status.CONVERGED
        duration = sum(p.duration for p in self._parts)
        doubts = (*(text for part in self._parts for text in part.doubts), *self._suspects.texts)
        if self._slow:
            doubts += (
                f"{', '.join(self._slow)} never faster than {STRAIGHT:g} rad/s: friction may be straight or bend, and "
                "the intervals contain both; move faster",
            )
        return ArmEstimate(
            source,
            status,
            poor,
            tuple(joints),
            parameters,
            links,
            duration,
            self._growth(),
            self.payload,
            factors,
            doubts,
            missed=tuple(missed),
            contradiction=contradiction,
            mistaken=self._mistaken,
        )

    def _growth(self) -> Value:
        """Return by how much friction grows with the load."""
        value, sigma = self._by_load
        if self._seen[-1]:
            return Value(value, sigma, "Nm/Nm", Verdict.ESTIMATED, "")
        if not sigma > 0.0:
            return Value(float("nan"), float("nan"), "Nm/Nm", Verdict.NOT_EXCITED, "no gear bears a load")
        return Value(max(0.0, value), sigma, "Nm/Nm", Verdict.PRIOR, "the law of friction is without it")
