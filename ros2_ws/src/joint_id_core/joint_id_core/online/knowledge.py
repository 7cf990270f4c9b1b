"""What is known of one joint: a fit of a whole window, the memory that follows the samples since, and its changes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Belief
from joint_id_core.estimators.shared.stillness import seen_by
from joint_id_core.online.changes import Changes
from joint_id_core.online.checks import Checked
from joint_id_core.online.follower import Follower
from joint_id_core.online.lasting import Lasting
from joint_id_core.online.late_sensor import Late, late_sensor
from joint_id_core.online.levels import Levels
from joint_id_core.online.memory import Memory, agree
from joint_id_core.online.offsets import Offsets
from joint_id_core.online.published import Said, published, said
from joint_id_core.online.symmetric import inverse_of
from joint_id_core.online.task import Task
from joint_id_core.online.tracker import Tracker
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterChange, Status


class Knowledge:
    """What is known of one joint.

    Args:
        task: what is identified.
        last: fit of a whole window that converged, or an earlier estimate; noise levels begin at its own.
        mean, covariance: with which the memory begins, shapes (k,) and (k, k), in estimation coordinates.
        age_s: time of motion in s that is in them already.
        noise_sigma: see `Levels`, of the noise levels of `last`.
        lasting: what earlier windows have shown of the joint; None if there were none.

    Attributes:
        last: the newest fit of a whole window; `noise`, not this fit, has the noise levels of today.
        follower: memory and filter.
        changes: of the joint.
        still: standard deviations of the labels that show rest; None if the window does not say.
    """

    def __init__(
        self,
        task: Task,
        last: Estimate,
        mean: Array,
        covariance: Array,
        age_s: float = 0.0,
        noise_sigma: float = np.inf,
        lasting: Lasting | None = None,
    ) -> None:
        self._lasting = lasting or Lasting(task.options.memory_s)
        self.last = last = self._lasting.on(last)
        self.still: dict[str, float] | None = None
        self.changes = Changes(last.free, task.coordinates, task.options.window_s)
        self._words: tuple[tuple[object, ...], Said] | None = None  # with what they tell of
        self._same: tuple[tuple[object, ...], object, Estimate] | None = None  # at rest, with what it tells of
        self._task = task
        self._offsets = Offsets(task.model, last.free, task.coordinates.spread, task.options.window_s)
        memory = Memory(mean, covariance, task.coordinates.spread)
        effect = None if last.checks is None else last.checks.levels
        levels = Levels(np.square(list(last.noise.values())), len(mean), noise_sigma, effect)
        self.follower = Follower(memory, task.coordinates, task.options, levels, self._tracker, age_s, task.background)

    @classmethod
    def from_window(
        cls, task: Task, fit: Estimate, recording: Recording, lasting: Lasting | None = None, age_s: float = 0.0
    ) -> Knowledge:
        """Begin with a window in motion and its fit; `lasting` and `age_s` as above."""
        after = Belief.after(fit, task.coordinates)
        tracker = task.tracker(recording, after.mean, fit)
        blocks = None if tracker is None else tracker.start()
        if tracker is None or not blocks:
            return cls(task, fit, after.mean, np.asarray(np.linalg.inv(after.precision)), age_s, lasting=lasting)
        data = tracker.data
        before = Belief.before_data(data, task.coordinates)
        known = cls(task, fit, before.mean, np.asarray(np.linalg.inv(before.precision)), age_s, lasting=lasting)
        known.still = seen_by(data.labels, data.y, data.period, fit.noise)
        known.follower.begin(tracker, [block.piece() for block in blocks])
        if data.rest[-1]:
            known.follower.rest()
        return known

    def comes_from(self, samples: Recording) -> None:
        """Take the origin of the samples of today, in place of that of an earlier run."""
        self.last = replace(self.last, origin=samples.origin, source=samples.source, joint=samples.joint)

    @property
    def noise(self) -> dict[str, float]:
        """Noise levels of today: standard deviations by name."""
        return dict(zip(self.last.noise, np.sqrt(self.follower.levels.values).tolist(), strict=True))

    def _tracker(self, recording: Recording, z: Array) -> Tracker | None:
        return self._task.tracker(recording, z, replace(self.last, noise=self.noise))

    def agrees(self, checked: Checked) -> bool:
        """Take the findings of a window that was fitted by itself; return whether it agrees.

        With a doubt, the newest innovations are not those that the noise levels allow: the fit shows whether the noise
        changed or the joint. If the noise changed, most of what is known of its levels is forgotten, so
        that the next samples move them soon.
        """
        fit = checked.fit
        if checked.doubted and not (fit.converged and agree(fit, self.follower.now(), self._task.coordinates)):
            return False
        if self.take(fit) and checked.doubted:
            self.follower.levels.doubt(since=fit.start)
        return True

    def take(self, fit: Estimate) -> bool:
        """Take what a fit that agrees shows of the joint; return whether it can be taken."""
        last = self.last
        if not fit.converged or fit.free != last.free or set(fit.noise) != set(last.noise):
            return False
        self.last = self._lasting.on(replace(fit, noise={n: fit.noise[n] for n in last.noise}))
        return True

    def late_sensor(self, recording: Recording) -> Late | None:
        """Return the sensor whose delay explains a window of a joint that is as it was; None if there is none."""
        mean, covariance = self.follower.memory.mean, self.follower.memory.covariance
        tracker = self._tracker(recording, mean)
        blocks = None if tracker is None else tracker.start()
        if tracker is None or not blocks:
            return None
        return late_sensor(tracker, [block.piece() for block in blocks], mean, inverse_of(covariance))

    def estimate(self, window: SlidingWindow) -> Estimate:
        """Return the estimate at the end of a window in motion."""
        chi2 = self.last.chi2 if self.follower.chi2 is None else self.follower.chi2
        return self._published(self.changes.told, samples=len(window), start=window.start, end=window.end, chi2=chi2)

    def unchanged(
        self, window: SlidingWindow, recent: SlidingWindow, status: Status, notes: tuple[str, ...]
    ) -> Estimate:
        """Return what is known, for the `recent` samples, which add nothing to it.

        While the joint rests this stays the same, but for the instants.
        """
        memory, told, fields = self.follower.memory, (status, notes), {"start": recent.start, "end": recent.end}
        basis = (memory, memory.newest, self.last, self.follower.tracker)
        if (
            self._same is None
            or self._same[1] != told
            or any(a is not b for a, b in zip(self._same[0], basis, strict=True))
        ):
            found = self._published((), samples=len(window), chi2=self.last.chi2, **fields)
            found = found.noted(notes, status=status)
            self._same = (basis, told, found) if self.follower.tracker is None else None
            return found
        return self._same[2].updated(**fields)

    def _published(self, changes: tuple[ParameterChange, ...], **fields: Any) -> Estimate:
        """Return the estimate of now, with these other `fields`."""
        coordinates, (mean, covariance) = self._task.coordinates, self.follower.now()
        now = mean, self._offsets.widened(covariance, self.follower.memory)
        fields |= {"noise": self.noise, "changes": changes}
        return published(coordinates, self.last, now, self._in_words(now, changes), fields)

    def _in_words(self, now: tuple[Array, Array], changes: tuple[ParameterChange, ...]) -> Said:
        """Return what is said of what is known.

        Words are made anew only when the memory has got a block or lost some, or something else happened: within half a
        second verdicts hardly change, and to find words takes longer than to find the estimate.
        """
        basis = (self.follower.memory.newest, self.last, changes)
        if self._words is None or any(old is not new for old, new in zip(self._words[0], basis, strict=True)):
            task = self._task
            self._words = basis, said(task.model, task.coordinates, self.last, now, changes)
        return self._words[1]
