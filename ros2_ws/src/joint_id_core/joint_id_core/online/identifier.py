"""Identification while the robot moves: sliding windows, warm starts, and a memory of older windows."""

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

# Growth of the drive's noise from one window to the next at which the memory is doubted.
SURPRISE = 2.0
# Ends of a fit with the memory that a wrong memory may have brought about.
UNEXPLAINED = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED)
ROUNDING = 1e-6  # share of a window's length: hops that add up to the whole of it are a window, whatever their rounding
CHANGED = "The joint has changed: older windows are forgotten."
WARM_UP = 100  # samples before the new ones that show the state of the joint


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
    """Fits one joint again and again while samples arrive.

    Each window starts from the last estimate (warm start). Its prior is the estimate whose window ended where
    this one starts, its covariance grown by what `memory_s` forgets: so no sample counts twice, and what older
    windows taught is kept (arrival cost). Windows without motion teach nothing and leave the memory as it is. When
    a window needs far more noise than the last one, or is not explained, it is fitted by itself as well; if that
    explains it, the joint has changed (a load was picked up, say) and the memory is dropped.

    A window is fitted as a whole, with its noise levels and all tests, once in its length. Between, the last estimate
    is extended by the samples that came since, unless these do not agree with it.

    Args:
        model: model of the joint.
        settings: as in `estimators.fit`.
        options: window, hop, memory.
        estimator: `Innovations`, or another one, which then fits every window by itself, without memory.

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
        self._fitted = -np.inf  # end of the last window that was fitted as a whole, if it converged
        self._past: deque[Estimate] = deque()

    def update(self, samples: Recording) -> Estimate | None:
        """Take samples; fit and return the estimate when a hop has passed, else None.

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
        return self._extended() or self._fit(self._window.recording())

    def _extended(self) -> Estimate | None:
        """The last estimate extended by what came since; None when it is time for a fit of the window.

        That is once a window's length, or where the new samples do not agree with the last estimate.
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
        """Noise of the drive that the estimate needs: what a wrong memory is explained by. Inf after a failed fit."""
        drive = self.model.inputs[0]
        return max(estimate.noise.get(f"input {drive.name}", np.inf), 1e-3 * drive.scale)

    def _belief(self, start: float) -> Belief | None:
        """The newest estimate that ended before `start`, widened by the time since and by the window's length."""
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
