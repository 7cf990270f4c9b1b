"""The Butterworth differentiator of `offline.py`, sample by sample for all joints of a robot at once.

The forward pass is the recursive filter, whose state is kept. The backward pass is the impulse response of the same
filter over the samples of a fixed lag, cut off where less than 1e-6 of it is left, and scaled to gain 1 at frequency
zero. The result equals that of the whole signal to the same accuracy. A sample is returned when its lag has passed,
with its original stamp.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.fixed_lag import FilterDesign, Run
from joint_id_core.filtering.offline import FilterOptions, derivatives

_STAMPS = 50  # number of stamps from which the period is estimated if it is not given


@dataclass(frozen=True)
class FilteredSample:
    """All joints at one instant: `time` in s, channels of shape (joints,) with NaN for unknown values."""

    time: float
    channels: dict[str, Array]
    derived: frozenset[str]


class StreamingFilter:
    """Adds the velocities and accelerations that are not measured, with a fixed lag.

    Measured channels are not changed. With `options.causal` every channel goes through the same forward filter, and
    the time is shifted back by its group delay. Local cubics remove jitter and bridge gaps of up to `options.max_gap`
    periods; no samples are added. After a longer gap, a jump of the time or a change of channels the filter restarts.
    A value that is not finite affects only its own channel and joint. Values that such an event could falsify are NaN,
    and `events` says what happened.

    Attributes:
        period: sampling period in s; NaN until known.
        events: latest messages for the user, oldest first; the caller removes them.
        counts: number of events by kind: "gap", "time", "value", "channels", "rate".
    """

    def __init__(self, options: FilterOptions | None = None, period: float | None = None) -> None:
        """Prepare for samples every `period` s; None estimates the period from the first stamps.

        Raises:
            JointIdError: the sampling is too slow for the cutoff.
        """
        self.options = options or FilterOptions()
        self.period = float("nan")
        self.events: deque[str] = deque(maxlen=100)
        self.counts: Counter[str] = Counter()
        self._shape: dict[str, int] = {}
        self._last = -np.inf
        self._waiting: deque[tuple[float, dict[str, Array]]] = deque()
        self._design: FilterDesign | None = None
        self._run: Run | None = None
        if period is not None:
            self._set_period(period)

    @property
    def latency(self) -> float:
        """Time from the instant that a sample describes to its output, in s; NaN until the period is known.

        Jitter, gaps and the first sample after a start may add one period.
        """
        return (self._design.ahead + 4) * self.period + self._design.delay if self._design else float("nan")

    def push(self, time: float, channels: Mapping[str, ArrayLike]) -> list[FilteredSample]:
        """Add one sample, each channel a number or an array (joints,), and return the samples that became complete."""
        values = {name: np.atleast_1d(np.asarray(value, dtype=float)) for name, value in channels.items()}
        done: list[FilteredSample] = []
        shape = {name: len(value) for name, value in values.items()}
        step = time - self._last
        longest = self.options.max_gap * self.period * (1 + 1e-6)  # NaN, never exceeded, while the period is unknown
        if not np.isfinite(time) or step == 0 or -longest < step < 0:
            what = "repeats" if step == 0 else "is not finite" if not np.isfinite(time) else "is out of order"
            self._note("time", f"stamp {time:.9g} s {what}: sample left out")
            return done
        if step < 0:
            self._note("time", f"time jumps back from {self._last:.9g} s to {time:.9g} s: filter restarted")
            done = self._abandon()
        elif step > longest and self._waiting:
            self._note("gap", f"no sample from {self._last:.9g} s to {time:.9g} s ({step:.3g} s): filter restarted")
            done = self._abandon()
        elif shape != self._shape and self._waiting:
            self._note("channels", f"channels or joints change at {time:.9g} s: filter restarted")
            done = self._abandon()
        self._shape, self._last = shape, time
        self._waiting.append((time, values))
        if self._design is None:
            return done + self._learn_period()
        return done + self._advance(time, values)

    def restart(self, why: str, new_rate: bool = False) -> list[FilteredSample]:
        """Restart the filter; return the waiting samples without derived values (none with `causal`).

        With `new_rate` the period is estimated anew.
        """
        self._note("time", f"{why}: filter restarted")
        self._last = -np.inf
        done = self._abandon()
        if new_rate:
            self._design, self.period = None, float("nan")
        return done

    def _learn_period(self) -> list[FilteredSample]:
        """Estimate the period as soon as there are enough stamps, then filter the waiting samples."""
        if len(self._waiting) < _STAMPS:
            return []
        samples = list(self._waiting)
        try:
            self._set_period(float(np.median(np.diff([time for time, _ in samples]))))
        except JointIdError as error:
            self._note("rate", str(error))
            return self._abandon()
        self._waiting.clear()
        self._last = -np.inf
        return [done for time, values in samples for done in self.push(time, values)]

    def _set_period(self, period: float) -> None:
        self._design = FilterDesign(self.options, period)
        self.period = period

    def _advance(self, time: float, values: dict[str, Array]) -> list[FilteredSample]:
        """Filter a sample and return the samples whose lag has passed."""
        assert self._design is not None
        if self._run is None:
            wanted = derivatives(tuple(values))
            inputs = tuple(values) if self.options.causal else tuple(wanted)
            self._run = Run(self._design, inputs, wanted, time, sum(self._shape[name] for name in inputs))
        run = self._run
        row = np.concatenate([values[name] for name in run.inputs]) if run.inputs else np.zeros(0)
        bad = ~np.isfinite(row)
        if (bad & ~run.bad).any():
            columns = [f"{name}[{k}]" for name in run.inputs for k in range(len(values[name]))]
            names = [columns[k] for k in np.flatnonzero(bad & ~run.bad)]
            self._note("value", f"{', '.join(names)} at {time:.9g} s: not finite, left out for that joint")
        done = []
        run.take(time, row, bad)
        while run.step():
            while self._waiting and run.ready(self._waiting[0][0]):
                done.append(self._finish(*self._waiting.popleft(), run))
        return done

    def _finish(self, time: float, values: dict[str, Array], run: Run) -> FilteredSample:
        """Return one sample with its derived channels."""
        assert self._design is not None
        results, first = run.at(time), 0
        channels = dict(values)
        for name in run.inputs:
            rows = results[:, first : first + len(values[name])]
            first += len(values[name])
            if self.options.causal:
                channels[name] = rows[0]
            for k, derivative in enumerate(run.wanted.get(name, ()), 1):
                channels[derivative] = rows[k]
        return FilteredSample(time - self._design.delay, channels, run.derived)

    def _abandon(self) -> list[FilteredSample]:
        """Restart the filter; return the samples still in the lag without derived values (none with `causal`)."""
        waiting, self._run = list(self._waiting), None
        self._waiting.clear()
        if self.options.causal:
            return []
        done = []
        for time, values in waiting:
            wanted = derivatives(tuple(values))
            missing = {n: np.full_like(values[origin], np.nan) for origin, names in wanted.items() for n in names}
            done.append(FilteredSample(time, {**values, **missing}, frozenset(missing)))
        return done

    def _note(self, kind: str, text: str) -> None:
        self.counts[kind] += 1
        self.events.append(text)
