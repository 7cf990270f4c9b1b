"""By how much of a sample a drive comes late that is taken for held, and what that does to the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.filtered import run_through
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.intervals import with_covariance
from joint_id_core.estimators.shared.mean_drive import MOST, mean_square_share, slope
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

# Fall of -2 log likelihood from which a share is worth a fit. Parameters that make up for a late drive hide most of it.
LIKELY = 1.0
BESIDE = 10.0  # the same beside the parameters, of which rounding of an encoder makes small ones
EARLY = 2.5  # standard deviations by which a voltage acts later than recorded, from which intervals contain that
# Share of each value that is doubtful then, too: such a voltage has less noise than the record, whatever its times are.
# k_t of a simulated motor came out up to 0.9 % too small.
EARLY_ERROR = 0.01
RANK = 1e-10  # of the scaled information matrix: some parameters are not shown at all
WIDER = 2.0  # standard deviation over the former one from which the user is told


@dataclass(frozen=True)
class Lateness:
    """By how much of a sample the drive comes late, at the parameters of an estimate, as far as the motion tells.

    Attributes:
        likely: share of a sample by which it should come earlier; 0 if that is hardly more likely than a held drive.
        beside: the same if all parameters may change as well, by as little as is linear.
        information: inverse of the variance of `beside`.
        effect: change of the free parameters with a share of 1, shape (free,).
    """

    likely: float
    beside: float
    information: float
    effect: Array

    @property
    def sigma(self) -> float:
        """Standard deviation of `beside`; at most that of a drive of which nothing is known."""
        return min(self.information**-0.5, MOST) if self.information > 0.0 else MOST

    def share_contained(self, estimate: Estimate, model: Model) -> Estimate:
        """Return the estimate of a mean drive, whose intervals contain that its share is not known exactly."""
        return self._with_mean_square(estimate, model, self.sigma**2)

    def contained(self, estimate: Estimate, model: Model) -> Estimate:
        """Return the estimate of a held drive, whose intervals contain that it may not be."""
        if self.beside < -EARLY * self.information**-0.5 and model.stiffness is None and model.torque_drive is None:
            return self._early(estimate, model)
        wider = self._with_mean_square(estimate, model, mean_square_share(self.beside, self.information))
        grown = np.diag(wider.covariance) > WIDER**2 * np.diag(estimate.covariance)
        if not grown.any():
            return wider
        names = listed([n for n, more in zip(estimate.free, grown, strict=True) if more])
        share = f"{max(self.beside, 0.0):.2g} ± {self.sigma:.1g}"
        told = (
            f"this motion hardly tells whether {model.drive} was held between samples (it may come {share} of a sample "
            f"late): the interval of {names} contains both; record all samples of the controller"
        )
        notes = (*wider.notes[:1], sentence(told), *wider.notes[1:])
        return wider.noted(notes)

    def _early(self, estimate: Estimate, model: Model) -> Estimate:
        """Return the same for a voltage that acts after its record, as behind the filter of an amplifier."""
        doubted = EARLY_ERROR * np.array([estimate[name].value for name in estimate.free])
        covariance = estimate.covariance + (self.beside**2 + 1.0 / self.information) * np.outer(
            self.effect, self.effect
        )
        wider = with_covariance(model, estimate, covariance + np.diag(doubted**2))
        told = (
            f"{model.drive} seems to act {-self.beside:.2g} of a sample after its record (filter of the amplifier?): "
            "the intervals contain that; correct its times, or record it at the motor"
        )
        notes = (*wider.notes[:1], sentence(told), *wider.notes[1:])
        return wider.noted(notes)

    def _with_mean_square(self, estimate: Estimate, model: Model, square: float) -> Estimate:
        return with_covariance(model, estimate, estimate.covariance + square * np.outer(self.effect, self.effect))


def lateness(estimate: Estimate, model: Model, recording: Recording) -> Lateness | None:
    """Return by how much of a sample the drive should come earlier; None if the filter does not run there.

    Innovations are linear in the drive, so their squares are a parabola in the share: three passes tell it. Where these
    parameters make up for a late drive, as viscous friction does, it is its share beside all changes of them that are
    as small.
    """
    assert model.drive is not None
    data = prepare(model, recording, ParameterSettings.of_estimate(estimate), leave_out_rests=True)
    kernel, k = compile_model(model, "tanh", data.freed, estimate.cell), model.input_names.index(model.drive)
    more = np.zeros_like(data.u)
    more[:, k] = slope(data.recording, data.time, data.u[:, k])
    recursion, held = run_through(data, kernel, estimate.noise, estimate.substeps)
    if not np.isfinite(held.cost):
        return None
    beside, information, effect = _beside(recursion, held, k, more[:, k])
    half, most = (
        recursion.with_inputs(data.u + share * more).run(held.free, held.levels, held.steps).cost
        for share in (0.5 * MOST, MOST)
    )
    bent, likely = held.cost - 2.0 * half + most, 0.0
    if np.isfinite(bent) and bent > 0.0:
        share = float(np.clip(0.5 * MOST * (0.5 + (held.cost - half) / bent), 0.0, MOST))
        likely = share if 2.0 * bent * (share / MOST) ** 2 > LIKELY else 0.0
    if likely == 0.0 and beside > 0.0 and beside**2 * information > BESIDE:
        likely = min(beside, MOST)
    return Lateness(likely, beside, information, effect)


def _beside(recursion: Recursion, held: Pass, channel: int, more: Array) -> tuple[float, float, Array]:
    """Return the share by which an input should come earlier if the parameters may change as well.

    Returns:
        the share, its information, and the change of the free parameters with a share of 1, shape (free,).
    """
    cross, total, score = recursion.disturbances(held, np.array([channel]), more[:, None])
    scale = 1.0 / np.sqrt(np.maximum(held.hessian.diagonal(), 1e-300))
    inverse = np.linalg.pinv(held.hessian * np.outer(scale, scale), rcond=RANK, hermitian=True)
    by = inverse @ (cross[:, 0] * scale)
    information = max(float(total[0, 0] - by @ (cross[:, 0] * scale)), 1e-300)
    return float(score[0] - by @ (held.gradient * scale)) / information, information, -by * scale
