"""Whether slow parts of what moves a flexible joint ask for the same values as all of it.

A gear is stiff, and in ordinary motion motor and link move nearly as one: how much of the inertia and of the friction
is at which side is then told by fast motion alone, a thousandth of the amplitude, which friction at a reversal and the
noise in the controller's loop excite. What the model lacks up there (ripple of an encoder, the current loop, noise of a
sensor that is no torque) makes little of the residuals, and moves such values by tens of standard deviations.

If the model is right, its residuals have nothing to do with any signal from before, so slow parts of the derivatives
may weigh them in place of the derivatives (instrumental variables; a test of over-identification, Hausman, Econometrica
46, 1978; Hansen, Econometrica 50, 1982). Where values by such weights differ by more than chance, the model is wrong
for fast motion, and what is certain is what slow motion says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.sentences import listed

# Cut-offs of the weights, over the sampling rate, and the slowest of them, whose values hold where these differ.
TESTED, SLOW = (0.01, 0.02, 0.04), (0.01, 0.01 / 3.0)
# Standard deviations of a difference from which it is none by chance; and where the residuals are not white: then
# something is lacking, and this tells what it does.
SIGNIFICANT, COLOURED = 5.0, 2.5
# A recorded motion that is an input has noise, which is in the weights and which the filter remembers for some samples:
# weights are older than the residuals by that many, and tell less. Of 62 right fits the largest was 4.2.
OLDER_OF_INPUT = 30
OF_INPUT, COLOURED_OF_INPUT = 4.5, 3.0
# Standard deviation of a stiffness, over its value, from which more than slow motion tells is a guess; and that where
# the motion of the link is recorded. Of a UR3e's shoulder it is 0.3 to 0.4, and the halves of a log agree within 4 %.
UNSURE, UNSURE_OF_INPUT = 0.25, 0.5
LEAST = 0.05  # variance of a difference over that of the value: less would not matter
INDEPENDENT = 1e-9  # share of the largest singular value of the weights from which they count


@dataclass(frozen=True)
class SlowParts:
    """What slow parts say.

    Attributes:
        excess: addition to the covariance of the coordinates, shape (k, k); zero if all parts ask for the same values.
        text: warning for the user; empty in that case.
        doubt: why the estimate cannot be used; empty if the intervals contain what is wrong.
    """

    excess: Array
    text: str = ""
    doubt: str = ""


@dataclass(frozen=True)
class _Fit:
    """A pass of a fit, for k coordinates.

    Attributes:
        weights: derivatives of the predicted labels over sqrt(S), shape (T, labels, k).
        older: samples by which weights are older than what they weigh.
        residuals: shape (T, labels).
        precision: of the prior, shape (k, k).
        pull: of the prior, shape (k,).
        step: that is left to the minimum, shape (k,).
    """

    weights: Array
    older: int
    residuals: Array
    precision: Array
    pull: Array
    step: Array

    def slow(self, low_pass: Callable[[Array], Array]) -> Array:
        """Return what a causal filter along the first axis leaves of the weights before each sample."""
        begin = np.zeros((self.older, *self.weights.shape[1:]))
        return low_pass(np.concatenate((begin, self.weights))[: len(self.weights)])

    def asked(self, instruments: Array) -> tuple[Array, Array]:
        """Return how far values by other weights (T, labels, n) are from the minimum, (k,), and their covariance."""
        size = np.sqrt(np.einsum("tkp,tkp->p", instruments, instruments))
        scaled = instruments / np.where(size > 0.0, size, 1.0)
        seen = np.einsum("tkp,tkq->pq", scaled, self.weights)
        inverse = np.linalg.pinv(np.einsum("tkp,tkq->pq", scaled, scaled), rcond=INDEPENDENT, hermitian=True)
        covariance = np.linalg.inv(seen.T @ inverse @ seen + self.precision)
        moved = seen.T @ inverse @ np.einsum("tkp,tk->p", scaled, self.residuals) + self.pull
        return covariance @ moved - self.step, covariance


def slow_parts(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, coloured: bool
) -> SlowParts:  # fmt: skip
    """Compare values by slow parts with those of the fit.

    Args:
        recursion, coordinates, found, last: of the fit, with its latest pass.
        coloured: whether its residuals are not white.
    """
    model, free = recursion.data.model, recursion.data.free
    if model.stiffness is None:
        return SlowParts(np.zeros_like(found.hessian))
    recorded = "link_position" in model.input_names
    weights = recursion.sensitivities(last) * coordinates.slope_at(last.free)
    fit = _Fit(
        weights, OLDER_OF_INPUT if recorded else 0, last.residuals,
        found.hessian - np.einsum("tkp,tkq->pq", weights, weights),
        found.gradient - np.einsum("tkp,tk->p", weights, last.residuals),
        found.inverse @ found.gradient,
    )  # fmt: skip
    limits = (OF_INPUT, COLOURED_OF_INPUT) if recorded else (SIGNIFICANT, COLOURED)
    away = _away(fit, np.diag(found.inverse))
    if not np.max(away) > limits[coloured]:
        return SlowParts(np.zeros_like(found.hessian))
    excess = _left_open(fit, found)
    most = sorted(np.argsort(-away)[:2].tolist())
    said = (
        f"slow parts of the motion ask for other values than fast ones (by {np.max(away):.2g} sigma: "
        f"{listed([free[k] for k in most])}), as the ripple of an encoder, the current loop or noise that is no torque "
        "does"
    )
    lost = UNSURE_OF_INPUT if recorded else UNSURE
    if model.stiffness in free and np.sqrt(np.diag(excess))[free.index(model.stiffness)] > lost:
        why = f"only fast ones tell {model.stiffness}, and what of inertia and friction is at which side of the gear"
        return SlowParts(excess, doubt=f"{said}; {why}")
    return SlowParts(excess, f"{said}: the standard deviations contain what the slow ones say")


def _away(fit: _Fit, variance: Array) -> Array:
    """Return how far each value is from those by slow parts, in standard deviations of that distance, shape (k,)."""
    from scipy.signal import butter, lfilter  # half a second

    largest = np.zeros(len(variance))
    for cut_off in TESTED:
        low, below = butter(2, 2.0 * cut_off)
        rate = low[0] * np.array([1.0, 0.0, -1.0])  # of the same filter: both phases of a motion near its edge
        slow = [fit.slow(partial(lfilter, part, below, axis=0)) for part in (low, rate)]
        away, covariance = fit.asked(np.concatenate(slow, axis=2))
        chance = np.sqrt(np.maximum(np.diag(covariance) - variance, LEAST * variance))
        largest = np.maximum(largest, np.abs(away) / chance)
    return largest


def _left_open(fit: _Fit, found: Minimum) -> Array:
    """Return what is to be added to the covariance, so that it is what the slowest parts say, shape (k, k)."""
    from scipy.signal import butter, sosfilt

    slow = [fit.slow(partial(sosfilt, butter(4, 2.0 * cut_off, output="sos"), axis=0)) for cut_off in SLOW]
    away, covariance = fit.asked(np.concatenate(slow, axis=2))
    size, axes = np.linalg.eigh(covariance - found.inverse)
    return np.asarray((axes * np.maximum(size, 0.0)) @ axes.T + np.outer(away, away))
