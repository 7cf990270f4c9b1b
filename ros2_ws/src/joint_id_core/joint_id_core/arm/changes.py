"""What changed when the torques of an arm are not those that its belief predicts: the payload, a friction, or neither.

Beliefs that say what may have changed, with wide priors, are compared by the likelihood of the newest stretches of
motion (Bayes factors: Kass & Raftery, Journal of the American Statistical Association 90, 1995). The wide priors make a
belief that allows more pay for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from joint_id_core.arm.belief import Belief
from joint_id_core.arm.equations import Equations
from joint_id_core.arm.information import sum_of
from joint_id_core.data.recording import Array

SURE = 2.0 * np.log(1e6)  # twice the logarithm of a Bayes factor from which a change is told
OPEN = 2.0 * np.log(10.0)  # from which the newest stretches are not believed yet
# Mean square of what is left of a torque over what was before: up to which it is explained, and up to which it
# surely is that alone.
EXPLAINED, CLEAN = 9.0, 3.0
# Change of a friction that is told, as a share of it and in standard deviations; a smaller one is followed.
TOLD, CLEAR = 0.1, 3.0
FRICTION = 0.5  # standard deviation of a friction that may have changed, as a share of it
# Standard deviations of a payload of which nothing is known: its mass as a share of that of the arm, the distance of
# its centre from the last joint in m, and its size in m.
MASS, DISTANCE, SIZE = 0.3, 0.3, 0.2
AFTER = 2  # stretches at least since a change
PAYLOAD = "payload"


@dataclass(frozen=True)
class Finding:
    """What the newest stretches of motion say.

    Attributes:
        what: "payload", the name of a joint whose friction changed, or "" if nothing did.
        opened: gives a belief that is open to that change.
        first: number of the stretch in which it came.
        gain: twice the logarithm of the Bayes factor over a belief in which nothing changed.
        felt: how many stretches feel that it came. Nothing is believed of these.
    """

    what: str
    opened: Callable[[Belief], Belief]
    first: int
    gain: float
    felt: int = 1

    def since(self, parts: Sequence[Equations]) -> Sequence[Equations]:
        """Return the stretches after it."""
        return parts[self.first + self.felt :]

    def clear_in(self, belief: Belief, parts: Sequence[Equations]) -> Finding | None:
        """Return the change if it explains the stretches since then; None if it does not, or not yet.

        Equations are filtered: a change at the end of a stretch is felt in the next one, too.
        """
        for felt, most in ((1, CLEAN), (2, EXPLAINED)):
            found = replace(self, felt=felt)
            since = found.since(parts)
            if len(since) >= AFTER and explains(self.opened(belief), since, most):
                return found
        return None


def payload_sigma(arm_mass: float) -> Array:
    """Return standard deviations of the parameters (10,) of an unknown payload of an arm with this mass in kg."""
    mass = MASS * arm_mass
    return mass * np.array([1.0, *3 * [DISTANCE], *6 * [SIZE**2]])


def find(belief: Belief, parts: Sequence[Equations], joints: Sequence[str], arm_mass: float) -> Finding:
    """Return the most likely explanation of the newest stretches.

    A change comes in one of them, of which nothing is believed, and at least `AFTER` follow it.
    """
    best, most = Finding("", lambda same: same, 0, 0.0), -np.inf
    told = [belief.information([part]) for part in parts]
    for first in range(len(parts) - AFTER):
        before, after = (sum_of(some) for some in (told[:first], told[first + 1 :]))
        unchanged = 0.0 if before is None else belief.evidence(before)
        assert after is not None
        same = belief.evidence(after)
        for what, opened in _possible(belief, joints, arm_mass):
            found = opened(belief).evidence(after)
            if found - same > 0.0 and unchanged + found > most:
                most, best = unchanged + found, Finding(what, opened, first, found - same)
    return best


def explains(belief: Belief, parts: Sequence[Equations], most: float = EXPLAINED) -> bool:
    """Return whether a belief explains stretches, once it knows them, as well as those before were."""
    return not parts or bool(np.max(belief.told(belief.information(parts)).left(parts)) < most)


def with_other_friction(belief: Belief, joints: Sequence[int]) -> Belief:
    """Return a belief that is open to another friction and torque offset of some joints, given by number."""
    places = [np.append(belief.friction_of(j), belief.offsets.start + j) for j in joints]
    scale = belief.friction_scale
    sigma = [FRICTION * np.append(scale[:, j], scale[1, j]) for j in joints]
    return belief.widened(np.concatenate(places), np.concatenate(sigma))


def _possible(
    belief: Belief, joints: Sequence[str], arm_mass: float
) -> Iterator[tuple[str, Callable[[Belief], Belief]]]:
    """Give what may have changed, and what opens a belief to it."""
    yield PAYLOAD, lambda known: known.with_payload(payload_sigma(arm_mass))
    if belief.carries:
        yield PAYLOAD, lambda known: known.with_payload(None)
    for j, name in enumerate(joints):
        yield name, partial(with_other_friction, joints=[j])
