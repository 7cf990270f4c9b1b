"""Identification while the robot moves: a recursion over all samples, a memory that is tested, checks beside it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import DEFAULT, Estimator
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare
from joint_id_core.estimators.shared.sentences import message
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.stillness import STILL_S, seen_by
from joint_id_core.models import Model
from joint_id_core.online.checks import OWN_SHARE, Background, WindowChecks, at_once, mixed
from joint_id_core.online.follower import YOUNG, Follower, Found
from joint_id_core.online.memory import Memory, agree
from joint_id_core.online.motion import MotionWatch
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.published import DISAGREE, at_rest, changes_of, published, too_short, with_note
from joint_id_core.online.resume import as_of_now, known_of
from joint_id_core.online.tracker import Tracker
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterChange, Status

AGAIN_S = 1.0  # time between two fits of windows that the model does not describe
UNTESTED = "What was known before is not tested yet: move the joint for more than half a second."
MOVING = "The joint rests: the estimate stays as it is, move the joint to continue."


class OnlineIdentifier:
    """Identifies one joint repeatedly while samples arrive.

    The first window in motion is fitted as a whole. From then on every sample passes once through a filter with
    sensitivities, which adds its information to a memory (recursive prediction-error method, Ljung, System
    Identification, 2nd ed., ch. 11). What was seen is forgotten with the time constant `memory_s` of motion.

    Every half second, stretches of the newest samples are tested against the memory, with the noise levels that it
    knows. If parameters changed, those are forgotten and the others kept. If that does not explain the samples, the
    newest window is fitted by itself.

    From time to time the newest window is fitted as a whole, without the memory: for noise levels, tests of the
    residuals, and predictions. While the joint rests nothing is fitted, and the estimate stays.

    Args:
        model: model of the joint.
        settings: as in `estimators.fit`.
        options: window, hop, forgetting.
        estimator: `Innovations`; another estimator fits every window by itself, without a memory.
        background: does the checks of whole windows; by default they are done within `update`.

    Raises:
        JointIdError: unknown parameter names, wrong values or priors.
    """

    def __init__(
        self,
        model: Model,
        settings: ParameterSettings | None = None,
        options: OnlineOptions | None = None,
        estimator: Estimator = DEFAULT,
        background: Background = at_once,
    ) -> None:
        self.settings = settings or ParameterSettings()
        _, free = self.settings.applied_to(model)
        self.model, self.options, self.estimator = model, options or OnlineOptions(), estimator
        self._coordinates = Coordinates(model, free, self.settings.priors)
        self._watch = MotionWatch(model, self.options.window_s)
        self._window = SlidingWindow(self.options.window_s)  # samples in motion
        self._checks = WindowChecks(self.options.window_s, background)
        self._next = -np.inf  # end of the next hop
        self._fit_next = -np.inf  # earliest end of the next fit of a whole window
        self._last: Estimate | None = None  # newest fit of a whole window that converged
        self._follower: Follower | None = None
        self._restarted = False  # until the first windows agree, where they did not before
        self._resumed = False  # until the first window in motion after `resume`
        self._suspended: Estimate | None = None  # fit that shows why the memory does not describe the newest samples
        self._changes: tuple[ParameterChange, ...] = ()
        self._told: object = None  # the explanation that is in these changes

    @property
    def remembers(self) -> bool:
        """Whether it has a memory; without one, every window is fitted by itself."""
        return isinstance(self.estimator, Innovations) and self.options.memory_s > 0.0

    def resume(self, estimate: Estimate, gone_s: float) -> Estimate:
        """Continue from an earlier estimate of this joint; call it before the first `update`.

        Samples then need no first window. They are tested against the estimate as against any other memory, so a joint
        that has changed meanwhile is found.

        Args:
            estimate: what `update` returned, with status CONVERGED; it may come from a file.
            gone_s: time since then in s, by which the standard deviations are widened; inf if it is not known.

        Returns:
            The estimate as it is known now.

        Raises:
            JointIdError: the estimate is of another model or other settings, is no good one, or the identifier has no
                memory; the message says what differs. The identifier is as before.
        """
        if not self.remembers:
            raise JointIdError("no estimate is continued without a memory: take innovations, and a memory_s above 0")
        mean, covariance = known_of(self.model, self.settings, self._options, self._coordinates, estimate, gone_s)
        now = as_of_now(self.model, self._coordinates, (mean, covariance), estimate)
        self._follower = self._new_follower(mean, covariance, YOUNG * self.options.window_s)
        self._last, self._resumed = now, True
        return now

    def update(self, samples: Recording) -> Estimate | None:
        """Add samples; when a hop has passed, return the estimate, else None.

        Data that cannot be fitted give an estimate whose status says why.

        Raises:
            JointIdError: the samples are not later than those before; they are left out.
        """
        begun = time.perf_counter()
        recent = self._watch.recent
        first = recent.end == -np.inf
        recent.append(samples)
        if not len(samples):
            return None
        if first:
            self._next = recent.start + (self.options.hop_s if self._resumed else self.options.window_s)
        if first and self._last is not None:  # its origin is that of an earlier run
            self._last = replace(self._last, origin=samples.origin, source=samples.source, joint=samples.joint)
        # Half a sample of slack: a window of 1000 samples ends one period before its length.
        due = recent.end >= self._next - 1.5 * samples.duration / max(1, len(samples) - 1)
        if due:
            self._next = recent.end + self.options.hop_s
        if not self.remembers:
            return self._alone() if due else None
        self._follow(due)
        if not due:
            return None
        temperature = (self._window if self._watch.moving else recent).mean("temperature")
        return replace(self._estimate(), elapsed_s=time.perf_counter() - begun, temperature=temperature)

    def _follow(self, due: bool) -> None:
        """Pass new samples to the filter."""
        for samples, moves in self._watch.stretches(due):
            if moves:
                self._window.append(samples)
            if self._follower is None or self._suspended is not None:
                continue
            if moves and self._resumed and self._window.duration > self.options.window_s - 2.0 * STILL_S:
                self._settle(self._follower)
            if moves:
                self._follower.move(samples, self._window)
            else:
                self._follower.rest()

    def _tracker_of(self, recording: Recording, z: Array) -> Tracker | None:
        """Return a filter for a recording, at the reference z; None if it cannot be used or has other signals."""
        last = self._last
        assert last is not None
        try:
            data = prepare(self.model, recording, self.settings, leave_out_rests=True)
        except UnusableError:
            return None
        if set(data.noise_names) != set(last.noise):
            return None
        kernel = compile_model(self.model, "tanh", data.freed, self._options.cell)
        levels = np.square([last.noise[n] for n in data.noise_names])
        held = frozenset(self.settings.values)
        return Tracker(data, kernel, self._coordinates, z, levels, last.substeps, held)

    def _settle(self, follower: Follower) -> None:
        """Learn from the first window in motion after `resume` what an estimate does not hold.

        These are the labels that show rest, and the noise levels and integrator steps of today.
        """
        assert self._last is not None
        try:
            data = prepare(self.model, self._window.recording(), self.settings, leave_out_rests=True)
        except UnusableError:
            return
        self._resumed = False
        untested = not follower.memory.blocks and follower.found is Found.AGREES
        if set(data.noise_names) != set(self._last.noise) or untested:
            self._suspend()  # other signals than before, or values at which the filter fails
            return
        self._watch.noise = seen_by(data.labels, data.y, data.period, self._last.noise)
        self._checks.begin(-np.inf)  # the first one comes at once

    # --- estimates

    def _estimate(self) -> Estimate:
        """Return the estimate at a hop."""
        end, follower = self._watch.recent.end, self._follower
        if not self._watch.moving:
            return self._resting()
        if follower is not None and self._suspended is None:
            if follower.found is Found.WRONG_START:
                self._follower = self._last = None
                self._fit_next, self._restarted = -np.inf, True
            elif follower.found is Found.UNEXPLAINED:
                self._suspend()
        if self._follower is None or follower is None or self._suspended is not None:
            if self._window.duration < self.options.window_s - 2.0 * STILL_S and self._suspended is None:
                return too_short(self.model, self._window, self.options.window_s)
            if self._suspended is not None and end < self._fit_next:
                return with_note(self._suspended, self._window)
            self._fit_next = end + AGAIN_S
            started = self._started()
            return with_note(started, self._window) if self._restarted and started.converged else started
        assert self._last is not None
        self._restarted = self._restarted and follower.age_s < self.options.window_s
        if follower.found is Found.CHANGING or follower.lost_s > self.options.window_s or self._restarted:
            return with_note(self._last, self._window)
        if self._resumed and not follower.memory.blocks:
            return self._known(self._last, follower, Status.TOO_SHORT, (UNTESTED,))
        self._tell_changes(follower)
        if not self._check(follower):
            self._suspend()
            return with_note(self._last, self._window)
        return self._published(self._last, follower)

    def _suspend(self) -> None:
        """Fit the newest windows by themselves: no change of parameters explains the newest samples."""
        self._suspended, self._fit_next = self._last, -np.inf

    def _tell_changes(self, follower: Follower) -> None:
        """Take the newest change into what is published."""
        explanation, since = follower.explanation, follower.since
        if explanation is None or explanation is self._told:
            return
        assert self._last is not None
        self._told = explanation
        self._checks.begin(self._window.end)  # a window with the change in it tells nothing
        recent = {c.name: c for c in self._changes if since - c.since < self.options.window_s}
        z, covariance = follower.memory.mean, follower.memory.covariance
        self._changes = changes_of(self._last.free, self._coordinates, explanation.change, z, covariance, since, recent)

    def _resting(self) -> Estimate:
        recent, follower = self._watch.recent, self._follower
        if self._last is None or follower is None:
            return at_rest(self.model, recent)
        notes = (MOVING,) if follower.found is Found.AGREES else (DISAGREE, MOVING)
        return self._known(self._last, follower, Status.NO_MOTION, notes)

    def _known(self, last: Estimate, follower: Follower, status: Status, notes: tuple[str, ...]) -> Estimate:
        """Return what is known, for the newest samples, which add nothing to it."""
        recent, now = self._watch.recent, follower.now()
        found = published(self.model, last, self._coordinates, now, self._window, None, ())
        return replace(found, status=status, message=message(notes), notes=notes, start=recent.start, end=recent.end)

    # --- fits of whole windows

    @property
    def _options(self) -> Innovations:
        assert isinstance(self.estimator, Innovations)
        return self.estimator

    def _fit(self, recording: Recording) -> Estimate:
        """Fit a window by itself; the search begins at the newest fit."""
        return fit_innovations(self.model, recording, self.settings, self._options, previous=self._last)

    def _alone(self) -> Estimate:
        """Fit the window without a memory."""
        recording = self._watch.recent.recording()
        if not isinstance(self.estimator, Innovations):
            return self.estimator.fit(self.model, recording, self.settings)
        estimate = self._fit(recording)
        if estimate.converged:
            self._last = estimate
        return estimate

    def _started(self) -> Estimate:
        """Fit the window as a whole and begin a memory with it."""
        recording = self._window.recording()
        known = self._suspended is not None
        estimate = self._fit(recording)
        if not estimate.converged:
            if known:
                self._suspended = estimate
            return estimate
        self._last, self._suspended, self._changes = estimate, None, ()
        after = Belief.after(estimate, self._coordinates)
        tracker = self._tracker_of(recording, after.mean)
        pieces = None if tracker is None else tracker.start()
        if tracker is not None and pieces:
            self._watch.noise = seen_by(tracker.data.labels, tracker.data.y, tracker.data.period, estimate.noise)
            before = Belief.before_data(tracker.data, self._coordinates)
            self._follower = self._new_follower(before.mean, np.asarray(np.linalg.inv(before.precision)))
            self._follower.begin(tracker, pieces)
            if tracker.data.rest[-1]:
                self._follower.rest()
            estimate = self._published(estimate, self._follower)  # its friction may be sharper than that of the fit
        else:
            self._follower = self._new_follower(after.mean, np.asarray(np.linalg.inv(after.precision)))
        self._checks.begin(self._window.end)
        if known:
            notes = (estimate.notes[0], "The joint has changed: what was known is forgotten.", *estimate.notes[1:])
            return replace(estimate, message=message(notes), notes=notes)
        return estimate

    def _published(self, last: Estimate, follower: Follower) -> Estimate:
        """Return the estimate of the memory, with the findings of the last fit of a whole window."""
        now, white = follower.now(), follower.white
        return published(self.model, last, self._coordinates, now, self._window, white, self._changes)

    def _new_follower(self, mean: Array, covariance: Array, age_s: float = 0.0) -> Follower:
        memory = Memory(mean, covariance, self._coordinates.spread)
        return Follower(memory, self._coordinates, self.options, self._tracker_of, age_s)

    def _check(self, follower: Follower) -> bool:
        """Take noise levels and findings of a window that was fitted by itself; return whether it agrees."""
        last = self._last
        assert last is not None
        if follower.noise_changed and not self._checks.doubt:
            self._checks.ask()
        doubt = self._checks.doubt
        estimate = self._checks.run(self._window, self._fit)
        if estimate is None:
            return True
        self._checks.doubt = False
        if doubt and not (estimate.converged and agree(estimate, follower.memory, self._coordinates)):
            return False
        if not estimate.converged or estimate.free != last.free or set(estimate.noise) != set(last.noise):
            return True
        self._last = replace(estimate, noise=mixed(last, estimate, 1.0 if doubt else OWN_SHARE))
        if follower.tracker is not None:
            follower.tracker.levels = np.square([self._last.noise[n] for n in follower.tracker.data.noise_names])
        return True
