"""A change of a parameter while a joint was watched."""

from __future__ import annotations

import math
from dataclasses import dataclass

from joint_id_core.data.quantities import with_deviation

SHOWN = 3.0  # standard deviations by which a parameter must have changed to be named


@dataclass(frozen=True)
class ParameterChange:
    """A change of a parameter while the joint was watched: value and standard deviation before and after, SI units.

    `since` is the instant of the change in s, on the clock of the estimate. Where the model has not described much
    motion before and after it, it is not `sure`: perhaps the model does not describe all of the motion.
    """

    name: str
    before: float
    before_std_dev: float
    after: float
    after_std_dev: float
    since: float
    sure: bool = True

    @property
    def size(self) -> float:
        """The change in standard deviations of the difference."""
        return abs(self.after - self.before) / math.hypot(self.before_std_dev, self.after_std_dev)

    @property
    def text(self) -> str:
        """The change in words."""
        values = (
            f"{self.name} from {with_deviation(self.before, self.before_std_dev)} "
            f"to {with_deviation(self.after, self.after_std_dev)}"
        )
        if self.sure:
            return f"Changed: {values}."
        return f"Learned anew: {values}: the joint changed, or the model does not describe all of this motion."
