"""The result of an estimation: values, covariance, verdicts, fit, and the report made of them."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from joint_id_core.data.recording import Array

# Posterior over prior standard deviation: above the first the data taught next to nothing, above the second
# less than half of what is needed to call the parameter estimated.
NOT_EXCITED_RATIO = 0.95
PRIOR_RATIO = 0.5
# Correlation from which two parameters are known together but hardly apart.
STRONG_CORRELATION = 0.95


class Status(enum.Enum):
    """How an estimation ended. `advice` tells the user what to do."""

    CONVERGED = "converged"
    POOR_FIT = "poor_fit"
    MAX_ITERATIONS = "max_iterations"
    DIVERGED = "diverged"
    NO_MOTION = "no_motion"
    TOO_SHORT = "too_short"
    MISSING_SIGNAL = "missing_signal"

    @property
    def advice(self) -> str:
        """What the status means and what to do about it."""
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "converged",
    Status.POOR_FIT: "the model does not describe this motion: try another model or friction law, and do not "
    "trust the standard deviations",
    Status.MAX_ITERATIONS: "stopped before it converged: allow more iterations or start nearer to the truth (--set)",
    Status.DIVERGED: "no finite solution: check units, gear ratio and start values",
    Status.NO_MOTION: "no motion in this window: move the joint",
    Status.TOO_SHORT: "too few samples for a fit: record longer or widen the window",
    Status.MISSING_SIGNAL: "a signal that the model needs is missing",
}


class Verdict(enum.Enum):
    """What the data say of one parameter."""

    ESTIMATED = "estimated"  # the data determine it
    PRIOR = "prior"  # the data hardly narrow what was believed before
    NOT_EXCITED = "not_excited"  # this motion cannot show it at all
    AT_BOUND = "at_bound"  # the estimate ran into a bound
    FIXED = "fixed"  # held by the user or by the model's table


@dataclass(frozen=True)
class ParameterEstimate:
    """One row of the result. `std_dev` is NaN where there is none (fixed parameters, a failed fit).

    `reason` says in words why the verdict is what it is.
    """

    name: str
    unit: str
    value: float
    std_dev: float
    verdict: Verdict
    initial: float = float("nan")
    reason: str = ""


@dataclass(frozen=True)
class Checks:
    """What the tests of a fit's residuals and predictions found.

    Attributes:
        texts: what to say of it, the empty text where a test found nothing.
        excess: what it adds to the covariance of the estimation coordinates (`Belief`), shape (k, k).
        nrmse: as in `Estimate`.
        together: by parameter that enters only in combination, what is known instead.
    """

    texts: tuple[str, ...]
    excess: Array
    nrmse: Mapping[str, float]
    together: Mapping[str, str]


@dataclass(frozen=True)
class Estimate:
    """What an estimator returns.

    Attributes:
        model: registry name of the model.
        estimator: name of the estimator.
        status, message: how it ended and, in words, what to know.
        parameters: all parameters of the model in its order, fixed ones included.
        free: names of the estimated parameters, in the order of `covariance`.
        covariance: of the free parameters in SI units, shape (len(free), len(free)).
        nrmse: by signal, rms of prediction minus label over the label's standard deviation.
        noise: estimated standard deviation by label and noisy input, SI units.
        chi2: mean squared normalised innovation; 1 for a correct model.
        whiteness: by label, lag-one autocorrelation of the innovations; 0 for a correct model.
        deviance: -2 log likelihood of the labels at the estimate, without its constant term (NaN where an estimator
            has no likelihood); observations: how many label values it covers.
        substeps: RK4 steps a sample.
        iterations, elapsed_s: cost of the fit.
        start, end: first and last instant of the data in s.
        samples: number of samples used.
        predictions: by signal, the predicted labels, shape (T,), for plots; None for messages.
        checks: what tests of this fit found, or of the one that this estimate extends.
        notes: all that was found, in sentences, the most useful first; `message` holds the first ones.
    """

    model: str
    estimator: str
    status: Status
    message: str
    parameters: tuple[ParameterEstimate, ...]
    free: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    nrmse: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    chi2: float = float("nan")
    whiteness: Mapping[str, float] = field(default_factory=dict)
    deviance: float = float("nan")
    observations: int = 0
    substeps: int = 0
    iterations: int = 0
    elapsed_s: float = 0.0
    start: float = float("nan")
    end: float = float("nan")
    samples: int = 0
    predictions: Mapping[str, Array] | None = None
    checks: Checks | None = None
    notes: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the fit converged and describes the data."""
        return self.status is Status.CONVERGED

    @property
    def values(self) -> dict[str, float]:
        """Value of every parameter by name."""
        return {p.name: p.value for p in self.parameters}

    def __getitem__(self, name: str) -> ParameterEstimate:
        return next(p for p in self.parameters if p.name == name)
