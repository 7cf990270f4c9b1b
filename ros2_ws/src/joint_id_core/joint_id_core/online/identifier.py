"""Identification while the robot moves: sliding windows, warm starts, and priors from older windows."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import DEFAULT, Estimator
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.shared.sentences import message
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.extension import extend
from joint_id_core.online.window import SlidingWindow
from joint_id_core.options import check, option
from joint_id_core.results.estimate import Estimate, Status

# Growth of the drive's noise from one window to the next from which the prior from older windows may be wrong.
SURPRISE = 2.0
# Status of a fit that may be due to a wrong prior from older windows.
UNEXPLAINED = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED)
ROUNDING = 1e-6  # relative tolerance of a window's length, for hops that add up to it except for rounding
CHANGED = "The joint has changed: older windows are forgotten."
WARM_UP = 100  # samples before the new ones, from which the filter learns the state of the joint


@dataclass(frozen=True)
class OnlineOptions:
    """Options of the online identifier."""

    window_s: float = option(2.0, "length of the window that is fitted", "s", lower=0.1, upper=600.0)
    hop_s: float = option(0.5, "time between two fits", "s", lower=0.01, upper=600.0)
    memory_s: float = option(
        60.0, "time over which older windows are forgotten; 0 fits every window by itself", "s", lower=0.0, upper=1e6
    )

    def __post_init__(self) -> None:
        check(self)


class OnlineIdentifier:
    """Identifies one joint repeatedly while samples arrive.

    Each fit of a window starts from the last estimate (warm start). The prior is the estimate whose window ended where
    this one starts, with a covariance that grows with time (forgetting, time constant `memory_s`). So no sample counts
    twice, and the information of older windows is kept (arrival cost). Windows without motion do not change the prior.

    If a window needs far more noise than the last one, or is not explained, it is also fitted without a prior. If that
    fit explains the window, the joint has changed (it picked up a load, for example), and the older estimates are
    dropped.

    A full fit, with noise levels and all checks, is made once per window length. Between full fits, the last estimate
    is extended by the new samples, unless they disagree with it.

    Args:
        model: model of the joint.
        settings: as in `estimators.fit`.
        options: window, hop, forgetting.
        estimator: `Innovations`; another estimator fits every window by itself, without a prior.

    Raises:
        JointIdError: unknown parameter names, wrong values or priors.
    """

    def __init__(
        self,
        model: Model,
        settings: ParameterSettings | None = None,
        options: OnlineOptions | None = None,
        estimator: Estimator = DEFAULT,
    ) -> None:
        self.settings = settings or ParameterSettings()
        _, free = self.settings.applied_to(model)
        self.model, self.options, self.estimator = model, options or OnlineOptions(), estimator
        self._coordinates = Coordinates(model, free, self.settings.priors)
        self._window = SlidingWindow(self.options.window_s)
        self._next_fit = -np.inf
        self._last: Estimate | None = None
        self._fitted = -np.inf  # end of the last window with a full fit, if it converged
        self._past: deque[Estimate] = deque()

    def update(self, samples: Recording) -> Estimate | None:
        """Add samples; when a hop has passed, fit and return the estimate, else None.

        Data that cannot be fitted give an estimate whose status says why.

        Raises:
            JointIdError: the samples are not later than those before; they are left out.
        """
        first = self._window.end == -np.inf
        self._window.append(samples)
        if not len(samples):
            return None
        if first:
            self._next_fit = self._window.start + self.options.window_s
        # Half a sample of slack: a window of 1000 samples ends one period before its length.
        if self._window.end < self._next_fit - 1.5 * samples.duration / max(1, len(samples) - 1):
            return None
        self._next_fit = self._window.end + self.options.hop_s
        estimate = self._extended() or self._fit(self._window.recording())
        return replace(estimate, temperature=self._window.mean("temperature"))

    def _extended(self) -> Estimate | None:
        """Return the last estimate extended by the new samples; None if the window needs a full fit.

        A full fit is needed once per window length, and when the new samples disagree with the last estimate.
        """
        last, options = self._last, self.options
        if not isinstance(self.estimator, Innovations) or last is None or not options.memory_s:
            return None
        if not self._window.end - (1.0 - ROUNDING) * options.window_s < self._fitted:
            return None
        recording = self._window.recording(last.end - WARM_UP * (last.end - last.start) / last.samples)
        inflation = float(np.exp((self._window.end - last.end) / options.memory_s))
        estimate = extend(self.model, last, recording, self.settings, self.estimator, inflation)
        if estimate is not None:
            self._last = estimate
            self._past.append(estimate)
        return estimate

    def _fit(self, recording: Recording) -> Estimate:
        self._fitted = -np.inf
        if not isinstance(self.estimator, Innovations):
            return self.estimator.fit(self.model, recording, self.settings)
        estimate = fit_innovations(
            self.model, recording, self.settings, self.estimator,
            belief=self._belief(float(recording.time[0])), previous=self._last,
        )  # fmt: skip
        noisy = self._last is not None and self._drive_noise(estimate) > SURPRISE * self._drive_noise(self._last)
        if self._last is not None and (noisy or estimate.status in UNEXPLAINED):
            alone = fit_innovations(self.model, recording, self.settings, self.estimator)
            better = not estimate.converged or SURPRISE * self._drive_noise(alone) < self._drive_noise(estimate)
            if alone.converged and better:
                self._past.clear()
                notes = (alone.notes[0], CHANGED, *alone.notes[1:])
                estimate = replace(alone, message=message(notes), notes=notes)
        if estimate.converged:
            self._last, self._fitted = estimate, estimate.end
            self._past.append(estimate)
        return estimate

    def _drive_noise(self, estimate: Estimate) -> float:
        """Return the estimated noise of the drive, inf after a failed fit; a wrong prior makes it grow."""
        drive = self.model.inputs[0]
        return max(estimate.noise.get(f"input {drive.name}", np.inf), 1e-3 * drive.scale)

    def _belief(self, start: float) -> Belief | None:
        """Return the newest estimate that ended before `start` as a prior; None if there is none.

        Its covariance grows with the time since then plus the length of the window (forgetting).
        """
        if self.options.memory_s == 0.0:
            return None
        known: Estimate | None = None
        while self._past and self._past[0].end <= start:
            known = self._past.popleft()
        if known is None:
            return None
        self._past.appendleft(known)
        age = start - known.end + self.options.window_s
        return Belief.after(known, self._coordinates, inflation=float(np.exp(age / self.options.memory_s)))
