"""An arm that is identified while it works: learnt from its first motion, then followed stretch by stretch."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.belief import Belief
from joint_id_core.arm.changes import (
    CLEAR,
    EXPLAINED,
    OPEN,
    PAYLOAD,
    SURE,
    TOLD,
    Finding,
    explains,
    find,
    with_other_friction,
)
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations
from joint_id_core.arm.learning import learned
from joint_id_core.arm.rivals import Rival, Young
from joint_id_core.errors import JointIdError

LEARN_S, LONGEST_S = 20.0, 60.0  # of motion: when an arm is known for the first time, and when it is learnt
AGAIN = 1.5  # times the motion of the last fit, after which it is learnt anew with all of it
RIVAL_S = 30.0  # of motion in which a belief of another friction can win
SETTLED_S = 15.0  # of motion after which a friction that may have changed is compared with that before
YOUNG_S = 20.0  # of motion in which another change of the payload is taken for the same
HELD = 6  # newest stretches that are not believed yet: they are tested for a change
# Of motion that nothing explains: when it may be another friction of one joint, and when the arm is learnt anew.
FRICTION_S, PATIENCE_S = 6.0, 20.0


@dataclass(frozen=True)
class ArmChange:
    """What changed at an instant in s: "payload", or the name of a joint whose friction did; with the belief before."""

    what: str
    since: float
    before: Belief


class ArmFollower:
    """Follows an arm.

    Attributes:
        belief: what is known; None at first.
        changes: newest change of each kind, by what changed.
        unexplained: names of joints whose torque the belief does not explain now.
        rests: whether no joint moves.
        time: end of the newest stretch in s.
        used: number of instants that were used since the arm is known.
    """

    def __init__(
        self,
        joints: Sequence[str],
        arm_mass: float,
        belief: Belief | None = None,
        check: Callable[[Sequence[Equations]], None] = lambda parts: None,
        beforehand: Beforehand | None = None,
        description: Description | None = None,
    ) -> None:
        """Begin.

        Args:
            joints: names of the joints.
            arm_mass: mass of the arm in kg, which tells what payloads are possible.
            belief: what is known of it already.
            check: looks at the motion from which an arm is learnt, and raises a JointIdError if that is of no use.
            beforehand, description: see `learned`.
        """
        self.belief, self.changes = belief, dict[str, ArmChange]()
        self.unexplained: tuple[str, ...] = ()
        self.rests, self.time, self.used = True, float("nan"), 0
        self._joints, self._mass = tuple(joints), arm_mass
        self._first: list[Equations] = []  # from which it is learnt
        self._learning, self._check = belief is None, check
        self._beforehand, self._description = beforehand, description
        self._due = LEARN_S
        self._held: deque[Equations] = deque()
        self._rival: Rival | None = None
        self._opened: tuple[Belief, float, float] | None = None  # see `_open_friction`
        self._young: Young | None = None  # payload
        self._lost: list[Equations] = []  # newest stretches, that nothing explains

    @property
    def motion(self) -> float:
        """Motion in s that has been used."""
        return sum(part.duration for part in self._first) if self.belief is None else self.belief.duration

    @property
    def needed(self) -> float:
        """Motion in s from which an arm is known."""
        return LEARN_S

    def add(self, part: Equations) -> bool:
        """Take a stretch; return whether something new is known.

        Raises:
            JointIdError: `check` refuses the motion from which the arm would be learnt.
        """
        if len(part.time):
            self.time = float(part.time[-1])
        self.rests = not part.used.any()
        if self.rests:
            return False
        if self.belief is None:
            self._first.append(part)
            return self._learn()
        self._held.append(part)
        self.used += int(np.count_nonzero(part.used.any(axis=1)))
        return self._test()

    def _learn(self) -> bool:
        """Learn the arm from all of its motion, if it is time."""
        motion = sum(part.duration for part in self._first)
        if motion < self._due:
            return False
        self._due = AGAIN * motion
        try:
            self._check(self._first)
        except JointIdError:
            self._first.clear()
            self._due = LEARN_S
            raise
        try:
            self.belief = learned(self._first, self._beforehand, self._description)
        except JointIdError:  # too few equations yet
            return False
        if motion >= LONGEST_S:
            self._learning = False
            self._first.clear()
        return True

    def _test(self) -> bool:
        """Test the newest stretches for a change, and believe those that have passed."""
        assert self.belief is not None
        parts = list(self._held)
        found = find(self.belief, parts, self._joints, self._mass)
        if found.what == PAYLOAD and found.gain > SURE and (clear := found.clear_in(self.belief, parts)) is not None:
            self._take(clear)
            return True
        left = self.belief.left(parts[-3:])
        self.unexplained = tuple(n for n, value in zip(self._joints, left, strict=True) if value > EXPLAINED)
        if len(parts) < HELD or (found.gain > OPEN and len(parts) < 2 * HELD):
            return False
        oldest = self._held.popleft()
        if max(self.belief.left([oldest])) > EXPLAINED:
            return self._missed(oldest)
        self._lost.clear()
        self._believe(oldest)
        return True

    def _take(self, found: Finding) -> None:
        """Go on with a belief that is open to a change of the payload; the stretches that feel it are left out."""
        belief, parts, found = self._sought(found)
        self._held.clear()
        self._young, self.belief = None, belief
        for part in parts[: found.first]:
            self._believe(part)
        before = self.belief
        self.belief = found.opened(before)
        self._begin_to_follow()
        for part in found.since(parts):
            self._believe(part)
        self._young = Young(belief, parts)
        self.changes[PAYLOAD] = ArmChange(PAYLOAD, float(parts[found.first].time[0]), before)

    def _sought(self, found: Finding) -> tuple[Belief, list[Equations], Finding]:
        """Return a change, with the belief before it and the stretches since then.

        The first stretches after a change tell little of it. If they seem to hold another one soon, it is the same, and
        its instant is sought in all of them; unless what was before that instant needs a change, too.
        """
        assert self.belief is not None
        held = list(self._held)
        if self._young is not None:
            belief, parts = self._young.belief, [*self._young.parts, *held]
            again = find(belief, parts, self._joints, self._mass)
            if again.what == PAYLOAD and explains(belief, parts[: again.first]):
                clear = again.clear_in(belief, parts)
                if clear is not None:
                    return belief, parts, clear
        return self.belief, held, found

    def _begin_to_follow(self) -> None:
        """Follow a belief that is open to a change."""
        self._rival, self.unexplained, self._learning = None, (), False
        self._lost.clear()
        self._first.clear()

    def _believe(self, part: Equations) -> None:
        """Make the belief sharper by a stretch of motion, and let it compete with one of another friction."""
        assert self.belief is not None
        if self._young is not None:
            self._young.parts.append(part)
            if self._young.motion > YOUNG_S:
                self._young = None
        if self._learning:
            self.belief = self._after(self.belief, part)
            self._first.append(part)
            self._learn()
            return
        if self._rival is None or self.belief.duration - self._rival.since > RIVAL_S:
            other = with_other_friction(self.belief, range(len(self._joints)))
            self._rival = Rival(other, self.belief, float(part.time[0]))
        self._rival = self._rival.after(part, self.belief, self._after)
        self.belief = self._after(self.belief, part)
        if self._rival.lead > SURE:
            self._open_friction(self._rival.before, self._rival.time, self.belief.duration)
            self.belief, self._rival = self._rival.belief, None
        if self._opened is not None and self.belief.duration > self._opened[2] + SETTLED_S:
            (before, time, _), self._opened = self._opened, None
            self._tell_friction(before, time)

    def _after(self, belief: Belief, part: Equations) -> Belief:
        """Return a belief after a stretch of motion, which has the faults that were found before, too."""
        found = belief.after(part)
        if self._description is None or not found.faults.amounts:
            return found
        torque = belief.faults.torque(self._description, part, found.values, found.carries)
        return found.with_faults(belief, part, torque)

    def _open_friction(self, before: Belief, time: float, motion: float) -> None:
        """Note a belief before friction that may have changed at an instant in s, and the motion in s by now.

        If it may have changed again before it settled, that is one change: values in between are those of seconds.
        """
        first = (before, time) if self._opened is None else self._opened[:2]
        self._opened = (*first, motion)

    def _tell_friction(self, before: Belief, time: float) -> None:
        """Note of which joints the friction is clearly another one than before an instant in s."""
        assert self.belief is not None
        variance = np.diag(self.belief.covariance) + np.diag(before.covariance)
        variance += (self.belief.faults.shift - before.faults.shift) ** 2
        for j, name in enumerate(self._joints):
            places = before.friction_of(j)[:2]
            old, new = before.values[places], self.belief.values[places]
            sigma = np.sqrt(variance[places] + 2.0 * (self.belief.drift * old) ** 2)
            if np.any(np.abs(new - old) > np.maximum(TOLD * np.abs(old), CLEAR * sigma)):
                self.changes[name] = ArmChange(name, time, before)

    def _missed(self, part: Equations) -> bool:
        """Leave out a stretch that nothing explains; many are another friction, of one joint or all, or another arm."""
        assert self.belief is not None
        self._lost.append(part)
        motion = sum(part.duration for part in self._lost)
        if motion < FRICTION_S:
            return False
        every = range(len(self._joints))  # all of them change as an arm warms up
        for joints in (*([j] for j in every), every):
            opened = partial(with_other_friction, joints=joints)
            parts, before = self._lost[1:], self.belief  # it may have changed in the first one
            if explains(opened(before), parts):
                self.belief = opened(before)
                self._open_friction(before, float(parts[0].time[0]), before.duration)
                self._begin_to_follow()
                for one in parts:
                    self._believe(one)
                return True
        if motion < PATIENCE_S:
            return False
        self.belief, self._learning, self._due = None, True, LEARN_S
        for kept in (self._lost, self._first, self._held, self.changes):
            kept.clear()
        self._rival = self._young = self._opened = None
        self.unexplained = ()
        return True
