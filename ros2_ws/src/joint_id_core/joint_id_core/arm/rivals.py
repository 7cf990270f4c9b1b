"""Beliefs of an arm beside the present one, while the motion has not told yet which of them is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from joint_id_core.arm.belief import Belief
from joint_id_core.arm.equations import Equations


@dataclass(frozen=True)
class Rival:
    """A belief of another friction that competes with the present one.

    Attributes:
        belief: it.
        before: the belief when it began, at the instant `time` in s.
        lead: twice the logarithm of the Bayes factor over the present belief since then.
    """

    belief: Belief
    before: Belief
    time: float
    lead: float = 0.0

    @property
    def since(self) -> float:
        """Motion in s before it began."""
        return self.before.duration

    def after(self, part: Equations, present: Belief, after: Callable[[Belief, Equations], Belief]) -> Rival:
        """Return it after a stretch of motion, for which the present belief was as given; `after` is that of both."""
        told = present.information([part])
        lead = self.lead + self.belief.evidence(told) - present.evidence(told)
        return replace(self, belief=after(self.belief, part), lead=lead)


@dataclass(frozen=True)
class Young:
    """A payload that changed lately: the belief before, and the stretches of motion since then."""

    belief: Belief
    parts: list[Equations]

    @property
    def motion(self) -> float:
        """Motion in s since then."""
        return sum(part.duration for part in self.parts)
