"""One candidate of a comparison, fitted and validated, and the criteria to compare two of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from joint_id_core.comparison.model_text import Candidate
from joint_id_core.data.recording import Array
from joint_id_core.results.estimate import Estimate

BLOCKS = 8  # stretches of the validation part; their scatter shows how much of a difference is chance
SIGMAS = 2.0  # a difference of held-out errors counts if it exceeds this many standard errors
LEAST = 0.01  # and this fraction of the error: a smaller one does not matter in practice
_TINY = 1e-12  # a relative error below rounding


@dataclass(frozen=True)
class Trial:
    """One candidate model after it was fitted and validated.

    Attributes:
        candidate: the model.
        estimate: the fit to the first part of the record.
        errors: by signal, normalised prediction errors on the validation part, shape (T,), NaN where not judged. The
            signals are the labels, and the drive if the model predicts it (`held_out_errors`, `held_out_drive_errors`).
        drive: name of the drive among these signals; empty if it is not among them.
        failure: why there are no errors; empty if there are errors.
    """

    candidate: Candidate
    estimate: Estimate
    errors: Mapping[str, Array] = field(default_factory=dict)
    drive: str = ""
    failure: str = ""

    @property
    def label(self) -> str:
        """Canonical text of the candidate."""
        return self.candidate.label

    @property
    def describes(self) -> bool:
        """Whether the fit converged, describes the first part and could be validated."""
        return self.estimate.converged and bool(self.errors)

    @property
    def labels(self) -> tuple[str, ...]:
        """Signals in the likelihood of the fit."""
        return tuple(self.estimate.nrmse)

    @property
    def free(self) -> int:
        """Number of estimated parameters. Noise levels are not counted: there are as many for the same labels."""
        return len(self.estimate.free)

    @property
    def bic(self) -> float:
        """Schwarz's criterion (1978), deviance + free log(observations); NaN without a likelihood."""
        n = self.estimate.observations
        return self.estimate.deviance + self.free * math.log(n) if n else math.nan

    @property
    def aic(self) -> float:
        """Akaike's criterion (1974), deviance + 2 free; NaN without a likelihood."""
        return self.estimate.deviance + 2.0 * self.free

    @property
    def nrmse(self) -> dict[str, float]:
        """By signal, rms of the normalised errors on the validation part."""
        return {name: float(np.sqrt(np.nanmean(e**2))) for name, e in self.errors.items()}


def same_data(a: Trial, b: Trial) -> bool:
    """Return whether the likelihoods of two fits cover the same measured values, so that BIC and AIC are comparable."""
    alike = a.labels == b.labels and a.estimate.observations == b.estimate.observations
    return alike and math.isfinite(a.bic) and math.isfinite(b.bic)


def common_signals(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Return the signals that all trials predict, in the order of the first trial."""
    return tuple(n for n in (trials[0].errors if trials else ()) if all(n in t.errors for t in trials))


class HeldOut:
    """Held-out errors of several trials on the samples and signals that all of them predict.

    The score of a trial is the geometric mean of its nrmse over the signals. So a ratio of scores does not depend on
    how the signals are scaled. Two trials differ if the logarithm of this ratio exceeds twice its standard error. The
    standard error comes from the ratios in `BLOCKS` stretches of the record.
    """

    def __init__(self, trials: Sequence[Trial], signals: Sequence[str]) -> None:
        logs = {name: _log_rms(np.array([t.errors[name] for t in trials])) for name in signals}
        logs = {name: both for name, both in logs.items() if np.isfinite(both[0]).all()}
        self.signals = tuple(logs)
        self._whole = np.mean([whole for whole, _ in logs.values()], axis=0) if logs else np.zeros(len(trials))
        self._blocks = np.mean([blocks for _, blocks in logs.values()], axis=0) if logs else np.zeros((len(trials), 0))
        self._index = {t.label: k for k, t in enumerate(trials)}

    def score(self, trial: Trial) -> float:
        """Return the geometric mean of the nrmse."""
        return float(np.exp(self._whole[self._index[trial.label]]))

    def ratio(self, worse: Trial, better: Trial) -> float:
        """Return the score of `worse` over the score of `better`."""
        return self.score(worse) / self.score(better)

    def apart(self, a: Trial, b: Trial) -> bool:
        """Return whether two trials differ by more than chance and by more than `LEAST`."""
        i, j = self._index[a.label], self._index[b.label]
        by_block = self._blocks[i] - self._blocks[j]
        by_block = by_block[np.isfinite(by_block)]
        if len(by_block) < 3:
            return False
        error = float(np.std(by_block, ddof=1)) / math.sqrt(len(by_block))
        return bool(abs(self._whole[i] - self._whole[j]) > max(math.log1p(LEAST), SIGMAS * error))


def _log_rms(errors: Array) -> tuple[Array, Array]:
    """Return the log rms of errors (n, T) over samples finite in every row: in all (n,), by block (n, BLOCKS)."""
    errors = np.where(np.isfinite(errors).all(axis=0), errors, np.nan)

    def level(part: Array) -> Array:
        seen = part[:, np.isfinite(part[0])]
        with np.errstate(invalid="ignore"):
            return (
                np.log(np.maximum(np.sqrt(np.mean(seen**2, axis=1)), _TINY))
                if seen.size
                else np.full(len(part), np.nan)
            )

    return level(errors), np.column_stack([level(part) for part in np.array_split(errors, BLOCKS, axis=1)])
