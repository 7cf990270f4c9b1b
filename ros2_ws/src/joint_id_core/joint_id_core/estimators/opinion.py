"""What inverse dynamics say of a recording that another estimator has fitted: the second opinion of `cross_check`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.changed_gain import changed_gain
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.missing import HELPS
from joint_id_core.estimators.shared.mean_drive import changes
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.standing import standing
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

if TYPE_CHECKING:  # SciPy loads with it
    from joint_id_core.estimators.regression.fitted import Fitted

# Residual torque of a KUKA's axes: 3 to 5 % of the energy, with an autocorrelation of 0.3 to 0.8 after a period of the
# band. Simulated white noise has less than 0.15.
MEMORY = 0.25
LITTLE = 0.01  # share of the torque that may be left, whatever its memory


@dataclass(frozen=True)
class Second:
    """Value and standard deviation of a parameter by the second estimator.

    `torque` is what one unit of the parameter makes, over the rms torque. The doubt is what the value may be off beside
    `sigma`, as that of the regression, where the model lacks something.
    """

    name: str
    value: float
    sigma: float
    torque: float
    doubt: float = 0.0

    @property
    def wide(self) -> float:
        """Standard deviation with the doubt."""
        return math.hypot(self.sigma, self.doubt)


@dataclass(frozen=True)
class Opinion:
    """What a regression says of a recording.

    Attributes:
        fault: why its equations are not those of the motion; empty if they are.
        seconds: what it knows of the parameters.
        r_squared: share of the torque that it explains.
        useless: options that would add a torque with which new samples are predicted no better.
        lag: how late or early the drive is against the motion; empty if it is not, or cannot be told.
        coloured: whether what it leaves of the torque has a memory and is not small.
        unseen: parameters that it finds this motion does not show.
        between: that the drive changes between two samples; empty if it is held.
        changed: that the gain of the drive changes, and when; empty if it does not.
        holds: whether it holds parameters that the estimate leaves free, so that its standard deviations lack them.
    """

    fault: str
    seconds: tuple[Second, ...]
    r_squared: float
    useless: frozenset[str] = frozenset()
    lag: str = ""
    coloured: bool = False
    unseen: tuple[str, ...] = ()
    between: str = ""
    changed: str = ""
    holds: bool = False


def suits(model: Model) -> bool:
    """Return whether there can be a second opinion on an estimate of this model; load what that needs."""
    from joint_id_core.estimators.regression.fit import suits as regression_suits

    # Noise of a current that is a state biases it, by little, but more than its sigma.
    if not regression_suits(model) or model.torque_drive is None:
        return False
    import scipy.signal  # noqa: F401  # half a second, which the first opinion of a live joint must not take

    return True


def second_opinion(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None = None,
    share: float = 0.0,
) -> Opinion | None:  # fmt: skip
    """Return what a regression says of a recording; None if the estimate failed, or if it does not suit the model.

    What the user holds, believes (priors) or frees has the value of the estimate, and is not checked. `share` is that
    of the next sample of a mean drive (`mean_drive`), if it is known; else the regression looks for it.
    """
    settings = settings or ParameterSettings()
    if estimate.status.unusable or estimate.status is Status.DIVERGED or not suits(model):
        return None
    from joint_id_core.estimators.regression.fit import with_share  # loads SciPy

    own = set(settings.fixed) | set(settings.freed) | set(settings.priors)
    held = [n for n in estimate.values if n not in estimate.free or n in own]
    if len(held) == len(estimate.values):
        return None
    values = ParameterSettings(estimate.values, held)
    try:
        data, _, fitted, share = with_share(model, recording, values, Regression(), share)
    except JointIdError:
        return None
    if any(f.blind for f in fitted):
        return None
    fault = next((f.fault for f in fitted if f.fault), "")
    stuck = standing(data)
    seconds = tuple(second for f in fitted for second in _seconds(f) if second.name not in stuck)
    useless = frozenset(advice for f in fitted for advice, share in f.helps.items() if share < HELPS)
    lag = next((f.lag for f in fitted if f.lag), "")
    coloured = any(f.memory > MEMORY and f.solution.r_squared < 1.0 - LITTLE for f in fitted)
    unseen = tuple(n for f in fitted for n, hidden in zip(f.names, f.solution.unseen, strict=True) if hidden)
    least = min(f.solution.r_squared for f in fitted)
    changed = next((text for f in fitted if (text := changed_gain(f.samples))), "")
    between = changes(model, share) if share else ""
    holds = any(name in own for name in estimate.free)
    return Opinion(fault, seconds, least, useless, lag, coloured, unseen, between, changed, holds)


def _seconds(fitted: Fitted) -> list[Second]:
    """Return what a regression knows of each parameter."""
    found, torque = fitted.solution, np.sqrt(np.mean(fitted.samples.columns**2, axis=0) / np.mean(fitted.samples.y**2))
    doubt = np.broadcast_to(np.hypot(found.doubt, found.changes), torque.shape)
    rows = zip(fitted.names, *(part.tolist() for part in (found.unbounded, found.sigma, torque, doubt)), strict=True)
    return [Second(*row) for row in rows if np.isfinite(row[2])]
