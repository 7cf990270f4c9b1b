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

from dataclasses import dataclass

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
# The same if a recorded motion is an input: the weights hold its noise. The largest of 24 right fits was 6.
OF_INPUT, COLOURED_OF_INPUT = 6.5, 4.0
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


def slow_parts(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, coloured: bool
) -> SlowParts:  # fmt: skip
    """Compare values by slow parts with those of the fit.

    Args:
        recursion, coordinates, found, last: of the fit, with its latest pass.
        coloured: whether its residuals are not white.
    """
    from scipy.signal import butter, lfilter, sosfilt  # half a second

    data, nothing = recursion.data, SlowParts(np.zeros_like(found.hessian))
    if data.model.stiffness is None or len(data.time) < 2:
        return nothing
    slope, residuals = coordinates.slope_at(last.free), last.residuals
    weights = recursion.sensitivities(last) * slope
    of_prior = found.hessian - np.einsum("tkp,tkq->pq", weights, weights)
    pull = found.gradient - np.einsum("tkp,tk->p", weights, residuals)
    step = found.inverse @ found.gradient  # `last` is one step before the minimum

    def asked(instruments: Array) -> tuple[Array, Array]:
        """Return how far the values are from those by weights (T, labels, n), shape (k,), and the covariance there."""
        size = np.sqrt(np.einsum("tkp,tkp->p", instruments, instruments))
        scaled = instruments / np.where(size > 0.0, size, 1.0)
        seen = np.einsum("tkp,tkq->pq", scaled, weights)
        inverse = np.linalg.pinv(np.einsum("tkp,tkq->pq", scaled, scaled), rcond=INDEPENDENT, hermitian=True)
        covariance = np.linalg.inv(seen.T @ inverse @ seen + of_prior)
        moved = seen.T @ inverse @ np.einsum("tkp,tk->p", scaled, residuals) + pull
        return covariance @ moved - step, covariance

    sigma = np.sqrt(np.diag(found.inverse))
    largest = np.zeros(len(sigma))
    for cut_off in TESTED:
        low, below = butter(2, 2.0 * cut_off)
        band = low[0] * np.array([1.0, 0.0, -1.0])  # the rate of the same filter: both phases of a motion near its edge
        away, covariance = asked(
            np.concatenate([lfilter(part, below, weights, axis=0) for part in (low, band)], axis=2)
        )
        chance = np.sqrt(np.maximum(np.diag(covariance) - sigma**2, LEAST * sigma**2))
        largest = np.maximum(largest, np.abs(away) / chance)
    recorded = "link_position" in data.model.input_names
    limits = (OF_INPUT, COLOURED_OF_INPUT) if recorded else (SIGNIFICANT, COLOURED)
    if not np.max(largest) > limits[coloured]:
        return nothing
    slow = [sosfilt(butter(4, 2.0 * cut_off, output="sos"), weights, axis=0) for cut_off in SLOW]
    away, covariance = asked(np.concatenate(slow, axis=2))
    size, axes = np.linalg.eigh(covariance - found.inverse)
    excess = np.asarray((axes * np.maximum(size, 0.0)) @ axes.T + np.outer(away, away))
    wide = np.sqrt(np.diag(excess))
    most = np.argsort(-largest)[:2]
    said = (
        f"slow parts of the motion ask for other values than fast ones (by {np.max(largest):.2g} sigma: "
        f"{listed([data.free[k] for k in sorted(most)])}), as the ripple of an encoder, the current loop or noise that "
        "is no torque does"
    )
    stiffness = data.model.stiffness
    if stiffness in data.free and wide[data.free.index(stiffness)] > (UNSURE_OF_INPUT if recorded else UNSURE):
        why = f"only fast ones tell {stiffness}, and with it what of inertia and friction is at which side of the gear"
        return SlowParts(excess, doubt=f"{said}; {why}")
    return SlowParts(excess, f"{said}: the standard deviations contain what the slow ones say")
