"""Whether the estimates of separate stretches of motion agree.

Each may look well by itself, with a memory of its own: on a joint that other joints load, the inertia went from 13 to
28 and to 53 kg m^2 within 40 s, each with a standard deviation of a tenth or less.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.quantities import with_deviation
from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.intervals import between
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.models import Model
from joint_id_core.online.memory import BLOCK_S
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict

KEPT = 8  # estimates, each of another window, that must agree
# Different fits while nothing described the motion, old and new values among them, up to which the new ones prove that
# the joint changed.
TRIED = 3
FAR = 4.0  # standard deviations of their difference from which two disagree; each may be 1.2 times too small
EVERY_S = 0.1  # estimates that follow each other sooner are not compared one by one, as long as none disagrees
MATTERS = 0.1  # least difference of a positive parameter over its value,
LEAST = -math.log(1.0 - MATTERS)  # and of its logarithm


@dataclass(frozen=True)
class _Told:
    """What was published at an instant in s.

    Attributes:
        time: the instant.
        estimate: what was published.
        z, sigma: value and standard deviation of each parameter, of its logarithm where it is positive; sigma is NaN
            for one that is not called estimated. Shapes (p,).
    """

    time: float
    estimate: Estimate
    z: Array
    sigma: Array


class Agreement:
    """Keeps what was published of separate windows, and says where the newest estimate disagrees with it.

    Args:
        model: of the joint.
        window_s: length of the window in s.
        wanted: whether estimates are compared at all.
    """

    def __init__(self, model: Model, window_s: float, wanted: bool = True) -> None:
        self._model, self._window_s, self._wanted = model, window_s, wanted
        self._positive = np.array([float(p.positive) for p in model.parameters])
        self._keep([])
        self._since, self._changed = KEPT, -np.inf  # windows since what is known changed; instant of the newest change
        self._tried: set[tuple[float, ...]] = set()  # values while nothing described the motion
        self._agreed = -np.inf  # instant of the newest estimate that was compared, if it disagreed with none

    def replaced(self) -> None:
        """A new memory, which a trial confirmed, replaces the one before: values from before it do not count.

        The joint may have changed once. If that comes again and again, or after many other fits, the model is at fault:
        all values count.
        """
        if self._since >= KEPT and len(self._tried) <= TRIED:
            self._keep([])
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
            # It was found in a block that began before it; what was told from then on did not know of it.
            self._keep([told for told in self._told if told.time < newest - BLOCK_S])
            self.replaced()
        elif self._agreed <= estimate.end < self._agreed + EVERY_S:
            return estimate
        rows = estimate.parameters
        z = np.array([p.value for p in rows])
        sigma = np.array([p.std_dev if p.verdict is Verdict.ESTIMATED else math.nan for p in rows])
        far = compile_shared().apart(z, sigma, self._positive, *self._stacked, FAR, LEAST)
        told = _Told(estimate.end, estimate, z, sigma)
        apart = self._apart(told) if far else {}  # hardly ever
        self._agreed = -np.inf if apart else estimate.end
        if not self._told or estimate.end >= self._told[-1].time + self._window_s:
            self._keep([*self._told[1 - KEPT :], told])
            self._since += 1
            self._tried.clear()
        return self._widened(estimate, apart) if apart else estimate

    def _keep(self, told: list[_Told]) -> None:
        """Keep what was told, and its values and standard deviations as matrices, shapes (n, p)."""
        self._told, shape = told, (len(told), len(self._positive))
        z, sigma = ([getattr(t, name) for t in told] for name in ("z", "sigma"))
        self._stacked = np.array(z).reshape(shape), np.array(sigma).reshape(shape)

    def _apart(self, newest: _Told) -> dict[str, ParameterEstimate]:
        """Return, by name, the earlier estimates that are farthest from the newest one, where that is too far."""
        z, sigma = self._stacked
        away = np.abs(newest.z - z)
        matters = (self._positive == 0.0) | (away >= LEAST)
        distance = np.where(matters, away, 0.0) / np.sqrt(newest.sigma * newest.sigma + sigma * sigma)
        far = distance > FAR  # never where one is not called estimated
        changed = {change.name: change.since for change in newest.estimate.changes}
        since = np.array([changed.get(p.name, -np.inf) for p in newest.estimate.parameters])
        far &= np.array([told.time for told in self._told])[:, None] >= since
        farthest = np.where(far, distance, 0.0).argmax(axis=0).tolist()
        rows = enumerate(newest.estimate.parameters)
        return {row.name: self._told[farthest[i]].estimate.parameters[i] for i, row in rows if far[:, i].any()}

    def _widened(self, estimate: Estimate, apart: Mapping[str, ParameterEstimate]) -> Estimate:
        rows, scale, told = {p.name: p for p in estimate.parameters}, np.ones(len(estimate.free)), []
        for name, old in apart.items():
            row = rows[name]
            said = f"{with_deviation(old.value, old.std_dev)} before, {with_deviation(row.value, row.std_dev)} now"
            told.append(f"{name} is {said}")
            rows[name] = between(self._model, row, (old.value, old.std_dev), said)
            scale[estimate.free.index(name)] = rows[name].std_dev / row.std_dev
        said = (
            f"windows disagree: {'; '.join(told)}: the joint or its load changed, or the model does not describe all "
            "of the motion"
        )
        notes = (sentence(said), "The value lies between, and the interval contains both.", *estimate.notes[1:])
        covariance = estimate.covariance * np.outer(scale, scale)
        return estimate.noted(notes, status=Status.DISAGREE, parameters=tuple(rows.values()), covariance=covariance)
