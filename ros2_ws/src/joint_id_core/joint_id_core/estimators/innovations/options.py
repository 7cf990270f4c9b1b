"""Options of the innovations estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import CELLS
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.options import check, option

MAX_SUBSTEPS = 64


@dataclass(frozen=True)
class InnovationsOptions:
    """Options of the innovations estimator."""

    max_iterations: int = option(50, "Gauss-Newton iterations in one stage", lower=1)
    substeps: int = option(0, "steps a sample; 0 finds them", lower=0, upper=MAX_SUBSTEPS)
    cell: str = option("rk4", "Runge-Kutta 4, or an implicit method for stiff joints", choices=CELLS)
    priors: str = option(
        "", "standard deviations known before any data, NAME=SD separated by commas; relative for positive parameters"
    )
    horizon_s: float = option(0.1, "how far ahead the predictions look whose nrmse is reported", "s", lower=0.0)

    def __post_init__(self) -> None:
        check(self)

    def known(self, model: Model, free: tuple[str, ...]) -> dict[str, float]:
        """`priors` by parameter of `model`, of which those `free` are estimated.

        Raises:
            JointIdError: text that is not NAME=SD, a parameter that is held, a deviation that is not positive.
        """
        found = {}
        for item in filter(None, (part.strip() for part in self.priors.split(","))):
            name, _, text = (part.strip() for part in item.partition("="))
            try:
                deviation = float(text)
            except ValueError:
                raise JointIdError(f"option priors: cannot read {item!r}: write NAME=SD, e.g. k_t=0.05") from None
            if not 0.0 < deviation < np.inf:
                raise JointIdError(f"option priors: {item!r}: a standard deviation is finite and above zero")
            if model.parameter(name).name not in free:
                raise JointIdError(f"option priors: {name} is held: free it (--free {name}) or leave its prior out")
            found[name] = deviation
        return found
