"""Identification while the robot moves: sliding windows, warm starts, and a memory of older windows."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core import estimators
from joint_id_core.errors import JointIdError
from joint_id_core.estimate import Estimate, Status
from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.extension import extend
from joint_id_core.estimators.innovations import fit_innovations
from joint_id_core.estimators.innovations_options import InnovationsOptions
from joint_id_core.models import Model
from joint_id_core.options import check, option
from joint_id_core.problem import split_parameters
from joint_id_core.recording import Recording

# Growth of the drive's noise from one window to the next at which the memory is doubted.
SURPRISE = 2.0
# Ends of a fit with the memory that a wrong memory may have brought about.
UNEXPLAINED = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED)
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


class SlidingWindow:
    """The latest samples of one joint."""

    def __init__(self, length_s: float) -> None:
        self._length = length_s
        self._parts: deque[Recording] = deque()

    @property
    def end(self) -> float:
        """Instant of the latest sample in s, -inf before the first."""
        return float(self._parts[-1].time[-1]) if self._parts else -np.inf

    @property
    def start(self) -> float:
        """Instant of the oldest sample kept in s."""
        return float(self._parts[0].time[0]) if self._parts else np.inf

    def append(self, samples: Recording) -> None:
        """Add later samples.

        Raises:
            JointIdError: they are not later than what is there.
        """
        if not len(samples):
            return
        end = self.end
        if samples.time[0] <= end:
            raise JointIdError(
                f"{samples.source}: time goes backwards from {end:.6f} s to {samples.time[0]:.6f} s: "
                "these samples were left out"
            )
        self._parts.append(samples)
        start = self.end - self._length
        while self._parts[0].time[-1] < start:
            self._parts.popleft()

    def recording(self, since: float = -np.inf) -> Recording:
        """The samples of the window from `since` on as one recording; a channel that a part lacks is NaN there."""
        start = max(since, self.end - self._length)
        parts: list[tuple[Recording, slice]] = []
        for part in reversed(self._parts):
            first = int(np.searchsorted(part.time, start))
            parts.append((part, slice(first, None)))
            if first:
                break
        parts.reverse()
        names: dict[str, None] = {}
        for part, _ in parts:
            names |= dict.fromkeys(part.channels)
        derived = frozenset().union(*(part.derived for part, _ in parts))
        channels = {
            n: np.concatenate([p.channels[n][rows] if n in p else np.full(len(p), np.nan)[rows] for p, rows in parts])
            for n in names
        }
        # the parts were checked, and so was their order
        return parts[-1][0].trusted(np.concatenate([p.time[rows] for p, rows in parts]), channels, derived)


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
        values, fixed, freed: as in `estimators.fit`.
        options: window, hop, memory.
        estimator: "innovations", or another of `estimators.ESTIMATORS`, which then fits every window afresh.
        fit_options: of the innovations estimator.

    Raises:
        JointIdError: unknown estimator, parameter names, values or priors.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float] | None = None,
        fixed: Collection[str] = (),
        options: OnlineOptions | None = None,
        estimator: str = "innovations",
        freed: Collection[str] = (),
        fit_options: InnovationsOptions | None = None,
    ) -> None:
        if estimator not in estimators.ESTIMATORS:
            raise JointIdError(f"unknown estimator {estimator!r}: choose one of {', '.join(estimators.ESTIMATORS)}")
        _, free = split_parameters(model, values or {}, fixed, freed)
        self.model, self.options, self.estimator = model, options or OnlineOptions(), estimator
        self._fit_options = fit_options or InnovationsOptions()
        self._coordinates = Coordinates(model, free, self._fit_options.known(model, free))
        self._values, self._fixed, self._freed = dict(values or {}), tuple(fixed), tuple(freed)
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
        if last is None or not options.memory_s or not self._window.end - options.window_s < self._fitted:
            return None
        recording = self._window.recording(last.end - WARM_UP * (last.end - last.start) / last.samples)
        inflation = float(np.exp((self._window.end - last.end) / options.memory_s))
        estimate = extend(
            self.model, last, recording, self._values, self._fixed, self._freed, self._fit_options, inflation
        )
        if estimate is not None:
            self._last = estimate
            self._past.append(estimate)
        return estimate

    def _fit(self, recording: Recording) -> Estimate:
        self._fitted = -np.inf
        if self.estimator != "innovations":
            return estimators.fit(
                self.model, recording, self._values, self._fixed, self._freed, estimator=self.estimator
            )
        estimate = fit_innovations(
            self.model, recording, self._values, self._fixed, self._freed, self._fit_options,
            belief=self._belief(float(recording.time[0])), previous=self._last,
        )  # fmt: skip
        noisy = self._last is not None and self._drive_noise(estimate) > SURPRISE * self._drive_noise(self._last)
        if self._last is not None and (noisy or estimate.status in UNEXPLAINED):
            alone = fit_innovations(self.model, recording, self._values, self._fixed, self._freed, self._fit_options)
            better = not estimate.converged or SURPRISE * self._drive_noise(alone) < self._drive_noise(estimate)
            if alone.converged and better:
                self._past.clear()
                estimate = replace(
                    alone, message=f"{alone.message}; the joint has changed: older windows are forgotten"
                )
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
