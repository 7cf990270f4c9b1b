"""Whether the estimates of separate stretches of motion agree.

Each may look well by itself, with a memory of its own: on a joint that other joints load, the inertia went from 13 to
28 and to 53 kg m^2 within 40 s, each with a standard deviation of a tenth or less.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.estimators.shared.intervals import between
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict

KEPT = 8  # estimates, each of another window, that must agree
# Different fits while nothing described the motion, old and new values among them, up to which the new ones prove that
# the joint changed.
TRIED = 3
FAR = 4.0  # standard deviations of their difference from which two disagree; each may be 1.2 times too small
MATTERS = 0.1  # least difference of a positive parameter over its value


@dataclass(frozen=True)
class _Told:
    """What was published at an instant in s: the parameters that were called estimated, by name."""

    time: float
    rows: Mapping[str, ParameterEstimate]


class Agreement:
    """Keeps what was published of separate windows, and says where the newest estimate disagrees with it.

    Args:
        model: of the joint.
        window_s: length of the window in s.
        wanted: whether estimates are compared at all.
    """

    def __init__(self, model: Model, window_s: float, wanted: bool = True) -> None:
        self._model, self._window_s, self._wanted = model, window_s, wanted
        self._told: deque[_Told] = deque(maxlen=KEPT)
        self._since, self._changed = KEPT, -np.inf  # windows since what is known changed; instant of the newest change
        self._tried: set[tuple[float, ...]] = set()  # values while nothing described the motion

    def replaced(self) -> None:
        """A new memory, which a trial confirmed, replaces the one before: values from before it do not count.

        The joint may have changed once. If that comes again and again, or after many other fits, the model is at fault:
        all values count.
        """
        if self._since >= KEPT and len(self._tried) <= TRIED:
            self._told.clear()
        self._since = 0

    def on(self, estimate: Estimate) -> Estimate:
        """Return an estimate that converged with what it disagrees with: status DISAGREE, intervals that contain both.

        After a change of the joint that is told, values from before it do not count: see `replaced`. Parameters that
        are said to have changed are compared with what was published since, in any case.
        """
        if estimate.status is Status.POOR_FIT and len(self._tried) <= TRIED:  # more need not be kept
            self._tried.add(tuple(p.value for p in estimate.parameters))
        if not (estimate.converged and self._wanted):
            return estimate
        newest = max((change.since for change in estimate.changes), default=-np.inf)
        if newest > self._changed:
            self._changed = newest
            self.replaced()
        rows = {p.name: p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED}
        changed = {change.name: change.since for change in estimate.changes}
        apart = {}
        for name, row in rows.items():
            earlier = [t.rows[name] for t in self._told if name in t.rows and t.time >= changed.get(name, -np.inf)]
            distances = [self._distance(row, old) for old in earlier]
            if max(distances, default=0.0) > FAR:
                apart[name] = earlier[int(np.argmax(distances))]
        if not self._told or estimate.end >= self._told[-1].time + self._window_s:
            self._told.append(_Told(estimate.end, rows))
            self._since += 1
            self._tried.clear()
        return self._widened(estimate, apart) if apart else estimate

    def _distance(self, row: ParameterEstimate, old: ParameterEstimate) -> float:
        """Return the difference of two values of a parameter in standard deviations; 0 if it does not matter."""
        if not self._model.parameter(row.name).positive:
            return abs(row.value - old.value) / math.hypot(row.std_dev, old.std_dev)
        if abs(row.value - old.value) < MATTERS * max(row.value, old.value):
            return 0.0
        return abs(math.log(row.value / old.value)) / math.hypot(row.std_dev / row.value, old.std_dev / old.value)

    def _widened(self, estimate: Estimate, apart: Mapping[str, ParameterEstimate]) -> Estimate:
        rows, scale, told = {p.name: p for p in estimate.parameters}, np.ones(len(estimate.free)), []
        for name, old in apart.items():
            row = rows[name]
            said = f"{old.value:.3g} ± {old.std_dev:.2g} before, {row.value:.3g} ± {row.std_dev:.2g} now"
            told.append(f"{name} is {said}")
            rows[name] = between(self._model, row, (old.value, old.std_dev), said)
            scale[estimate.free.index(name)] = rows[name].std_dev / row.std_dev
        said = (
            f"windows disagree: {'; '.join(told)}: the joint or its load changed, or the model does not describe all "
            "of the motion"
        )
        notes = (sentence(said), "The value lies between, and the interval contains both.", *estimate.notes[1:])
        return replace(
            estimate, status=Status.DISAGREE, message=message(notes), notes=notes, parameters=tuple(rows.values()),
            covariance=estimate.covariance * np.outer(scale, scale),
        )  # fmt: skip
