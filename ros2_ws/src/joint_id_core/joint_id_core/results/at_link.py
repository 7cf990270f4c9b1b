"""What a simulator wants of a joint: damping, Coulomb friction and rotor inertia, all seen at the link."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.quantities import with_deviation
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import MAGNITUDE

# By quantity: unit, and the parameters whose sum it is, each with the power of the gear ratio N that brings it to the
# link; a model without N is of a motor alone. The inertia of `rigid_joint` is that of rotor and link together, so it is
# none of a rotor.
PARTS: dict[str, tuple[str, dict[str, int]]] = {
    "damping": ("Nm s/rad", {"c": 0, "c_b": 2, "c_m": 2, "c_q": 0}),
    "friction": ("Nm", {"tau_f": 0, "tau_fc": 1, "tau_fm": 1, "tau_fq": 0}),
    "armature": ("kg m^2", {"J_r": 2, "J_m": 2}),
}


@dataclass(frozen=True)
class AtLink:
    """A quantity of a joint at the link, in the `unit`; `formula` says what it is made of."""

    name: str
    value: float
    std_dev: float
    unit: str
    formula: str

    @property
    def known(self) -> bool:
        """Whether it is known, by the rule of `estimated`: to half of its value."""
        return self.value > 0.0 and self.std_dev <= MAGNITUDE * self.value

    @property
    def text(self) -> str:
        """Value, standard deviation and formula in words."""
        return f"{self.name} {with_deviation(self.value, self.std_dev, self.unit)} = {self.formula}"


def at_link(estimate: Estimate) -> list[AtLink]:
    """Return the quantities that an estimate tells of.

    Standard deviations come from the covariance of all parts together: of sums that are known although their parts are
    not, too. One of a held torque constant, which scales all of them, is added. Parts that are held count as exact. A
    quantity whose parts are all held is left out.
    """
    values, found = estimate.values, []
    ratio = values.get("N", 1.0)
    constant = next((p for p in estimate.parameters if p.name == "k_t" and p.name not in estimate.free), None)
    scale = constant.std_dev / constant.value if constant is not None and math.isfinite(constant.std_dev) else 0.0
    for name, (unit, powers) in PARTS.items():
        own = {part: power if "N" in values else 0 for part, power in powers.items() if part in values}
        if not any(part in estimate.free for part in own):
            continue
        weights = np.array([ratio ** own[part] if part in own else 0.0 for part in estimate.free])
        value = sum(ratio**power * values[part] for part, power in own.items())
        variance = float(weights @ estimate.covariance @ weights) + (scale * value) ** 2
        terms = [part if power == 0 else f"N^{power} {part}".replace("^1", "") for part, power in own.items()]
        formula = " + ".join(terms) + (f", N = {ratio:g}" if any(own.values()) else "")
        found.append(AtLink(name, value, math.sqrt(variance) if variance >= 0.0 else math.nan, unit, formula))
    return found
