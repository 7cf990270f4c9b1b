"""Identification while the robot moves: a recursion over all samples, a memory that is tested, checks beside it."""

from __future__ import annotations

import time

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import DEFAULT, Estimator
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.shared.held_values import with_held_values
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.stillness import STILL_S, seen_by
from joint_id_core.models import Model
from joint_id_core.online.agreement import Agreement
from joint_id_core.online.beside import Beside
from joint_id_core.online.checks import Background, at_once
from joint_id_core.online.follower import BLOCK_S, YOUNG, Found
from joint_id_core.online.hops import Hops
from joint_id_core.online.knowledge import Knowledge
from joint_id_core.online.lasting import Lasting
from joint_id_core.online.motion import MotionWatch
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.published import DISAGREE, at_rest, forgotten, too_short, with_computed_load, with_note
from joint_id_core.online.resume import NOISE_SIGMA, as_of_now, known_of
from joint_id_core.online.situation import Situation
from joint_id_core.online.task import Task
from joint_id_core.online.trial import Trial
from joint_id_core.online.window import SlidingWindow, parts_of
from joint_id_core.results.estimate import Estimate, Status

PART_S = 0.25  # of samples that are followed at once: blocks stay blocks when samples come late and many at a time
UNTESTED = "What was known before is not tested yet: move the joint for more than half a second."
MOVING = "The joint rests: the estimate stays as it is, move the joint to continue."


class OnlineIdentifier:
    """Identifies one joint repeatedly while samples arrive.

    The first window in motion is fitted as a whole. From then on every sample passes once through a filter with
    sensitivities, which adds its information to a memory (recursive prediction-error method, Ljung, System
    Identification, 2nd ed., ch. 11). What was seen is forgotten with the time constant `memory_s` of motion.

    Every half second, stretches of the newest samples are tested against the memory, with the noise levels that it
    knows. If parameters changed, those are forgotten and the others kept. If that does not explain the samples, the
    newest window is fitted by itself. While little is known, all samples since the start are fitted again, in a search
    that begins anew.

    Noise levels are learned from all samples, too. From time to time, and when these levels are in doubt, the newest
    window is fitted as a whole, without the memory: for predictions and tests of the residuals, and to tell whether the
    noise changed or the joint. While the joint rests nothing is fitted, and the estimate stays.

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
        coordinates, window_s = Coordinates(model, free, self.settings.priors), self.options.window_s
        self._task = Task(model, self.settings, self.options, estimator, coordinates, background)
        self._watch = MotionWatch(model, window_s)
        self._window = SlidingWindow(window_s)  # samples in motion
        self._beside = Beside(model, self.settings, window_s, background, self.remembers)
        self._agreement = Agreement(model, window_s, self.remembers)
        self._hops = Hops(self.options.hop_s)
        self._alone: Estimate | None = None  # newest fit that converged, where there is no memory
        self._situation = Situation.STARTING
        self._known: Knowledge | None = None  # None while STARTING or RESTARTING
        self._trial, self._lasting = Trial(window_s), Lasting(self.options.memory_s)

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
            JointIdError: the estimate is of another model or other settings, or no good one, or there is no memory; the
                message says what differs. The identifier is as before.
        """
        if not self.remembers:
            raise JointIdError("no estimate is continued without a memory: take innovations, and a memory_s above 0")
        state, self._task = known_of(self._task, estimate, gone_s), self._task.continued(estimate)
        now = as_of_now(self._task, state, estimate)
        self._known = Knowledge(self._task, now, *state, YOUNG * self.options.window_s, NOISE_SIGMA, self._lasting)
        self._enter(Situation.RESUMED)
        self._beside.end_looks()
        return now

    def update(self, samples: Recording) -> Estimate | None:
        """Add samples; when a hop has passed, return the newest estimate, else None.

        Data that cannot be fitted give a status that says why. If hops are short, the estimate comes before the newest
        samples are tested: call `finish` when it is on its way, or the next samples do what is left to do.

        Raises:
            JointIdError: the samples are not later than those before; they are left out.
        """
        begun, newest = time.perf_counter(), None
        # Samples that waited while a window was fitted may be more than the window holds: they would be lost.
        longest_s = min(0.5 * self.options.window_s, PART_S) if self.remembers else np.inf
        for part in parts_of(samples, longest_s, self._watch.recent.period):
            newest = self._update(part) or newest
        if newest is None:
            return None
        newest = with_held_values(newest, self.model, self.settings)
        newest = with_computed_load(newest, self._watch.recent, self.model)
        warm = self._window if self._watch.moving else self._watch.recent
        return newest.updated(temperature=warm.temperature, elapsed_s=time.perf_counter() - begun)

    def finish(self) -> None:
        """Test and learn from the newest samples, if it is time for that."""
        if self._known is not None:
            self._known.follower.finish()

    def _update(self, samples: Recording) -> Estimate | None:
        """Add samples that are much shorter than the window; return the estimate when a hop has passed."""
        recent, known = self._watch.recent, self._known
        first = recent.end == -np.inf
        recent.append(samples)
        if not len(samples):
            return None
        if first:
            self._hops.begin(recent.start + (self.options.window_s if known is None else self.options.hop_s))
            if known is not None:
                known.comes_from(samples)
        due = self._hops.ends(recent)
        if not self.remembers:
            return self._without_memory() if due else None
        self._follow(due)
        if self.options.hop_s >= BLOCK_S:  # to wait for the next estimate would take long
            self.finish()
        if not due:
            return None
        stretch = self._beside.stretch
        if self._watch.moving:
            return stretch.on(self._agreement.on(self._in_motion()), self._trial.blames_sensor)
        return stretch.at_rest(self._at_rest())

    def _without_memory(self) -> Estimate:
        """Fit the newest samples by themselves."""
        recording = self._watch.recent.recording()
        estimate = self._task.fit(recording, self._alone)
        if estimate.converged:
            self._alone = estimate
        return self._task.cross_checked(estimate, recording, self.settings)

    # --- the situation

    def _enter(self, situation: Situation) -> None:
        """Go to another situation, or stay in this one."""
        if situation is self._situation:
            return
        again, self._situation = self._situation is Situation.ON_TRIAL, situation
        if not situation.follows:
            self._beside.forget_opinions()
        if situation is Situation.RESTARTING:
            assert self._known is not None
            if again:  # the joint may have changed, so the next fit takes no sample from before
                self._window = self._window.since(self._known.follower.since)
            self._beside.look_anew(self._window.recording())
            self._trial.begin_anew(self._known)
            self._known = None
        elif situation is Situation.SUSPENDED:
            assert self._known is not None
            self._beside.end_looks()
            self._trial.suspend(self._known)
        elif situation is Situation.FOLLOWING:
            self._trial = Trial(self.options.window_s)

    def _follow(self, due: bool) -> None:
        """Pass new samples to the filter."""
        for samples, moves in self._watch.stretches(due):
            if moves:
                self._window.append(samples)
                self._beside.append(samples)
            known = self._known
            if known is None or not self._situation.follows:
                continue
            if moves and self._situation is Situation.RESUMED and self._window_full:
                self._settle(known)
            if moves:
                known.follower.move(samples, self._window)
            else:
                known.follower.rest()

    @property
    def _window_full(self) -> bool:
        return self._window.duration > self.options.window_s - 2.0 * STILL_S

    def _settle(self, known: Knowledge) -> None:
        """Compare the first window in motion after `resume` with what is known, and go on or begin anew.

        The window tells which labels show rest. The check that comes next gives today's findings on the residuals and
        the integrator steps. Noise levels follow the samples, from the stored ones on.
        """
        data, follower = self._task.prepared(self._window.recording()), known.follower
        if data is None:
            return
        same_signals = set(data.noise_names) == set(known.last.noise)
        runs = bool(follower.memory.blocks) or follower.found is not Found.AGREES  # the filter, at the known values
        self._enter(self._situation.after_window(same_signals and runs))
        if self._situation is not Situation.SUSPENDED:
            self._watch.noise = seen_by(data.labels, data.y, data.period, known.last.noise)
            self._beside.begin(-np.inf)

    # --- estimates

    def _at_rest(self) -> Estimate:
        """Return the estimate at a hop while the joint rests."""
        known = self._known
        if known is None:
            return at_rest(self.model, self._watch.recent, self.settings)
        notes = (MOVING,) if known.follower.found is Found.AGREES else (DISAGREE, MOVING)
        return known.unchanged(self._window, self._watch.recent, Status.NO_MOTION, notes)

    def _in_motion(self) -> Estimate:
        """Return the estimate at a hop while the joint moves."""
        known, window, window_s = self._known, self._window, self.options.window_s
        replaced = self._situation is Situation.ON_TRIAL and self._trial.replaces
        if known is not None:
            follower = known.follower
            agreed = follower.age_s >= self._trial.length_s and not (replaced and self._trial.late(window.recording()))
            self._enter(self._situation.after_samples(follower.found, agreed))
        if known is None or not self._situation.follows:
            return self._fitted()
        untold = follower.found is Found.CHANGING or follower.astray or follower.lost_s > window_s
        if untold or self._situation is Situation.ON_TRIAL:
            return with_note(known.last, window)
        if self._situation is Situation.RESUMED and not follower.memory.blocks:
            return known.unchanged(window, self._watch.recent, Status.TOO_SHORT, (UNTESTED,))
        if known.changes.take(follower):
            self._beside.changed(window.end, follower.since)
        known = self._known = self._beside.looked_again(known, self._task, window, self._lasting)
        if not self._beside.agrees(known, self._task, window):
            self._enter(self._situation.after_window(agrees=False))
            return with_note(known.last, window)
        estimate = self._beside.judged(known.estimate(window), follower.tested_from)
        return forgotten(estimate, self._agreement) if replaced else estimate

    def _fitted(self) -> Estimate:
        """Fit the newest window as a whole, without the memory; if this converges, a memory begins with it."""
        situation, window, trial = self._situation, self._window, self._trial
        if situation is Situation.SUSPENDED:
            assert trial.shown is not None
            if not trial.due(self._watch.recent.end) or trial.late(window.recording()):
                return with_note(trial.shown, window)
        elif not self._window_full:
            if trial.shown is not None:
                return with_note(trial.shown, window)
            recent = window if len(window) else self._watch.recent
            return too_short(self.model, recent, self.options.window_s, self.settings)
        elif trial.shown is not None and trial.waits(self._watch.recent.end):
            return trial.shown.updated(end=window.end)
        recording, known, begun = window.recording(), self._known, time.thread_time()
        self._task, fit = self._task.fitted(recording, self.settings, known.last if known else None)
        if not fit.converged:
            trial.failed(fit, self._watch.recent.end, time.thread_time() - begun)
            # Beside a memory that does not describe the window, two estimators that disagree on it tell nothing more.
            return with_note(fit, window) if fit.status is Status.DISAGREE and known else fit
        trial.succeeded()
        known = self._known = Knowledge.from_window(self._task, fit, recording, self._lasting)
        if known.still is not None:
            self._watch.noise = known.still
        self._beside.begin(window.end)
        self._enter(situation.after_fit())
        if situation is not Situation.STARTING:
            return with_note(fit, window)
        return known.estimate(window) if known.follower.memory.blocks else fit  # whose friction may be less sharp
