"""Identification while the robot moves: a recursion over all samples, a memory that is tested, checks beside it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import DEFAULT, Estimator
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare, unusable
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.stillness import STILL_S, seen_by, still
from joint_id_core.models import Model
from joint_id_core.online.memory import Change, Memory, agree
from joint_id_core.online.published import changes_of, published, with_note
from joint_id_core.online.relearn import relearn
from joint_id_core.online.resume import as_of_now, known_of
from joint_id_core.online.tracker import Piece, Tracker
from joint_id_core.online.window import SlidingWindow
from joint_id_core.options import check, option
from joint_id_core.results.estimate import Estimate, ParameterChange, Status

BLOCK_S = 0.5  # length of the stretches that are added to the memory and tested
LINEAR = 0.02  # change of a coordinate up to which the result of a block is kept,
NEAR = 0.3  # or in standard deviations
JUMP = 300.0  # innovation, in standard deviations, from which a sensor jumped: the filter starts again
NOISIER = 1.5  # mean squared innovation of a label from which its noise is no longer that of the memory
QUIETER = 0.6  # the same, below which
CHECK_AFTER, CHECK_EVERY = (1, 2, 4), 8  # window lengths after which the newest window is fitted as a whole
AGAIN_S = 1.0  # time between two fits of windows that the model does not describe
YOUNG = 3.0  # window lengths of motion before which a disagreement is not taken for a change of the joint
ENOUGH = 100  # samples for a mean square
OWN_SHARE = 0.25  # weight of the noise levels of the newest window
UNTESTED = "What was known before is not tested yet: move the joint for more than half a second."
MOVING = "The joint rests: the estimate stays as it is, move the joint to continue."


@dataclass(frozen=True)
class OnlineOptions:
    """Options of the online identifier."""

    window_s: float = option(2.0, "length of the window that is fitted", "s", lower=0.1, upper=600.0)
    hop_s: float = option(0.5, "time between two estimates", "s", lower=0.01, upper=600.0)
    memory_s: float = option(
        60.0, "time of motion after which what was seen is forgotten; 0 fits every window by itself", "s",
        lower=0.0, upper=1e6,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)


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
        background: runs the checks of whole windows; None runs them within `update`.

    Raises:
        JointIdError: unknown parameter names, wrong values or priors.
    """

    def __init__(
        self,
        model: Model,
        settings: ParameterSettings | None = None,
        options: OnlineOptions | None = None,
        estimator: Estimator = DEFAULT,
        background: Executor | None = None,
    ) -> None:
        self.settings = settings or ParameterSettings()
        _, free = self.settings.applied_to(model)
        self.model, self.options, self.estimator = model, options or OnlineOptions(), estimator
        self._coordinates = Coordinates(model, free, self.settings.priors)
        self._background = background
        self._recent = SlidingWindow(max(self.options.window_s, 8.0 * STILL_S))
        self._window = SlidingWindow(self.options.window_s)  # samples in motion
        self._shows_rest: dict[str, float] | None = None  # noise of labels that tell rest from motion
        self._followed = -np.inf  # newest sample that went through the filter
        self._next = -np.inf  # end of the next hop
        self._fit_next = -np.inf  # earliest end of the next fit of a whole window
        self._last: Estimate | None = None  # newest fit of a whole window that converged
        self._memory: Memory | None = None
        self._tracker: Tracker | None = None
        self._block: Piece | None = None
        self._white: list[Array] = []
        self._moved_since = self._moved_until = -np.inf
        self._lost_s = 0.0  # time of motion since a block was added to the memory
        self._change: Change | None = None  # a change of which the new values are not known yet
        self._since: list[Piece] = []  # blocks since that change, the first one with the change in it
        self._unexplained = 0  # fits of these blocks that failed
        self._doubt = False  # whether the noise levels of the memory are wrong for the newest samples
        self._age = 0.0  # time of motion in the memory in s
        self._resumed = False  # until the first window in motion after `resume`
        self._suspended: Estimate | None = None  # fit that shows why the memory does not describe the newest samples
        self._changes: tuple[ParameterChange, ...] = ()
        self._checks = 0
        self._check_next = np.inf
        self._checking: Future[Estimate] | None = None

    @property
    def moving(self) -> bool:
        """Whether the joint moved in the last half second."""
        return self._recent.end - self._moved_until < BLOCK_S

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
        known = known_of(self.model, self.settings, self._options, self._coordinates, estimate, gone_s)
        now = as_of_now(self.model, self._coordinates, known, estimate)
        self._remember(*known, [])
        self._last, self._resumed = now, True
        self._age = YOUNG * self.options.window_s
        return now

    def update(self, samples: Recording) -> Estimate | None:
        """Add samples; when a hop has passed, return the estimate, else None.

        Data that cannot be fitted give an estimate whose status says why.

        Raises:
            JointIdError: the samples are not later than those before; they are left out.
        """
        begun = time.perf_counter()
        first = self._recent.end == -np.inf
        self._recent.append(samples)
        if not len(samples):
            return None
        if first:
            self._next = self._recent.start + (self.options.hop_s if self._resumed else self.options.window_s)
        if first and self._last is not None:  # its origin is that of an earlier run
            self._last = replace(self._last, origin=samples.origin, source=samples.source, joint=samples.joint)
        # Half a sample of slack: a window of 1000 samples ends one period before its length.
        due = self._recent.end >= self._next - 1.5 * samples.duration / max(1, len(samples) - 1)
        if due:
            self._next = self._recent.end + self.options.hop_s
        if not self.remembers:
            return self._alone() if due else None
        self._follow()
        if not due:
            return None
        shown = self._window if self.moving else self._recent
        temperature = shown.mean("temperature")
        return replace(self._estimate(), elapsed_s=time.perf_counter() - begun, temperature=temperature)

    # --- samples

    def _follow(self) -> None:
        """Pass new samples to the filter, and blocks of them to the memory.

        The newest ones wait: whether they belong to a rest shows a little later.
        """
        until = self._recent.end - STILL_S
        recent = self._recent.recording(self._followed - 2.0 * STILL_S)
        first, last = np.searchsorted(recent.time, [self._followed, until], "right").tolist()
        if first == last:
            return
        self._followed = float(recent.time[last - 1])
        at_rest = self._at_rest(recent)[first:last]
        edges = np.flatnonzero(np.diff(at_rest)) + 1
        for begin, end in pairwise([0, *edges.tolist(), last - first]):
            if at_rest[begin]:
                self._add_block()
                self._stop_tracking()
                self._moved_since = np.inf
            else:
                self._move(recent.slice(first + begin, first + end))

    def _at_rest(self, recent: Recording) -> NDArray[np.bool_]:
        """Return True for samples at rest, shape (T,)."""
        labels = tuple(n for n in self.model.state_names if n in recent and n not in recent.derived)
        if not labels or len(recent) < 2:
            return np.zeros(len(recent), dtype=bool)
        y = np.array([recent.channels[n] for n in labels]).T
        return still(labels, y, recent.duration / (len(recent) - 1), self._shows_rest)

    def _move(self, samples: Recording) -> None:
        """Follow samples in motion."""
        if self._moved_since == np.inf:
            self._moved_since = float(samples.time[0])
        self._lost_s += float(samples.time[-1]) - max(self._moved_until, float(samples.time[0]))
        self._moved_until = float(samples.time[-1])
        self._window.append(samples)
        if self._memory is None:
            return
        if self._resumed and self._window.duration > self.options.window_s - 2.0 * STILL_S:
            self._settle()
        if self._tracker is None:
            self._begin_tracking()
            return
        read = self._tracker.read(samples)
        piece = None if read is None else self._tracker.run(read)
        if piece is None or np.any(np.abs(piece.white) > JUMP):
            self._stop_tracking()
            self._moved_since = np.inf
            return
        self._block = piece if self._block is None else self._block + piece
        if self._block.duration > BLOCK_S - 1.5 * self._tracker.data.period:
            self._add_block()

    def _settle(self) -> None:
        """Learn from the first window in motion after `resume` what an estimate does not hold.

        These are the labels that show rest, and the noise levels and integrator steps of today.
        """
        assert self._last is not None and self._memory is not None
        try:
            data = prepare(self.model, self._window.recording(), self.settings, leave_out_rests=True)
        except UnusableError:
            return
        self._resumed = False
        untested = not self._memory.blocks and self._change is None
        if set(data.noise_names) != set(self._last.noise) or untested:
            self._suspend()  # other signals than before, or values at which the filter fails
            return
        self._shows_rest = seen_by(data.labels, data.y, data.period, self._last.noise)
        self._check_next = -np.inf

    def _begin_tracking(self) -> None:
        """Start the filter at the estimate of the memory, with the samples since the joint moves."""
        assert self._memory is not None
        tracker = self._tracker_of(self._window.recording(self._moved_since), self._coordinates.clip(self._memory.mean))
        pieces = None if tracker is None else tracker.start()
        if pieces:
            self._tracker, self._block = tracker, pieces[-1]

    def _tracker_of(self, recording: Recording, z: Array) -> Tracker | None:
        """Return a filter for a recording, at the reference z; None if it cannot be used or has other signals."""
        assert self._last is not None
        try:
            data = prepare(self.model, recording, self.settings, leave_out_rests=True)
        except UnusableError:
            return None
        if set(data.noise_names) != set(self._last.noise):
            return None
        kernel = compile_model(self.model, "tanh", data.freed, self._options.cell)
        levels = np.square([self._last.noise[n] for n in data.noise_names])
        held = frozenset(self.settings.values)
        tracker = Tracker(data, kernel, self._coordinates, z, levels, self._last.substeps, held)
        if self._memory is not None:
            tracker.sharpen(float(np.max(np.sqrt(np.diag(self._memory.covariance)) / self._coordinates.unit)))
        return tracker

    def _stop_tracking(self) -> None:
        """Stop the filter: the samples that follow are not those after the last one."""
        self._tracker = self._block = None
        self._since.clear()

    # --- tests

    def _add_block(self) -> None:
        """Add the present block to the memory and test it, or use it to learn what changed."""
        block, self._block = self._block, None
        memory, tracker = self._memory, self._tracker
        if block is None or memory is None or tracker is None or self._suspended is not None:
            return
        if self._change is not None:
            self._since.append(block)
            self._learn(self._change)
            return
        memory.add(block, self.options.memory_s)
        self._lost_s = 0.0
        self._white.append(block.white)
        del self._white[: -max(1, round(self.options.window_s / BLOCK_S))]
        self._age += block.duration
        self._change = self._tested()
        memory = self._memory
        assert memory is not None
        if self._change is not None and self._age < YOUNG * self.options.window_s:
            self._begin_anew()
            return
        if self._change is not None:
            self._since = list(self._change.blocks)
            memory.drop(len(self._since))
        elif self._noise_changed():
            self._check_next = -np.inf
            self._doubt = True
        self._refine()

    def _tested(self) -> Change | None:
        """Test the newest blocks against the memory; return the change that they show.

        The test is linear. Where little is known yet, the blocks may disagree only because of this, and one set of
        parameters describes them all.
        """
        memory, tracker = self._memory, self._tracker
        assert memory is not None and tracker is not None
        change = memory.test()
        if change is None:
            return None
        z = tracker.z
        learned = relearn(tracker, memory.blocks, *memory.before(), weights=memory.weights(self.options.memory_s))
        if learned is not None:
            other = memory.copy()
            other.replace(learned.pieces, self.options.memory_s)
            if other.test() is None:
                self._memory = other
                return None
        tracker.again(memory.blocks[-1:], z)
        return change

    def _refine(self) -> None:
        """Move the reference to the estimate; if it moved far, pass the newest blocks through the filter again."""
        memory, tracker = self._memory, self._tracker
        assert memory is not None and tracker is not None
        mean = self._coordinates.clip(memory.mean)
        sigma = np.sqrt(np.diag(memory.covariance))
        tracker.sharpen(float(np.max(sigma / self._coordinates.unit)))
        far = any(
            np.max(
                np.minimum(
                    np.abs(block.z - mean) / (LINEAR * self._coordinates.unit), np.abs(block.z - mean) / (NEAR * sigma)
                )
            )
            > 1.0
            for block in memory.blocks
        )
        if far and self._change is None:
            learned = relearn(tracker, memory.blocks, *memory.before(), weights=memory.weights(self.options.memory_s))
            if learned is not None:
                memory.replace(learned.pieces, self.options.memory_s)
                return
        tracker.move(mean)

    def _noise_changed(self) -> bool:
        """Return whether the innovations of the last window are far from what the noise levels allow."""
        for row in np.concatenate(self._white).T:
            known = row[np.isfinite(row)]
            if len(known) > ENOUGH and not QUIETER < float(known @ known) / len(known) < NOISIER:
                return True
        return False

    def _learn(self, change: Change) -> None:
        """Fit the changed parameters to the blocks after the one in which the change happened; keep the others."""
        memory, tracker, coordinates = self._memory, self._tracker, self._coordinates
        assert memory is not None and tracker is not None and self._last is not None
        mean, precision = change.still_known(coordinates.spread)
        stretch = self._since[-1]
        for block in reversed(self._since[1:-1]):
            if block.samples.time[-1] < stretch.begin.time:  # the joint rested in between
                break
            stretch = block + stretch
        learned = relearn(tracker, [stretch], mean, precision, changed=True)
        if learned is None or not learned.explained:
            self._unexplained += 1
            if self._unexplained * BLOCK_S > self.options.window_s:
                self._suspend()
            return
        age = self._age
        self._remember(mean, np.asarray(np.linalg.inv(precision)), learned.pieces)
        self._age = age
        after = self._memory
        assert after is not None
        z, covariance = after.mean, after.covariance
        since = stretch.begin.time
        recent = {c.name: c for c in self._changes if since - c.since < self.options.window_s}
        self._changes = changes_of(self._last.free, coordinates, change, z, covariance, since, recent)

    def _remember(self, z: Array, covariance: Array, pieces: Sequence[Piece]) -> None:
        """Begin a new memory with what was known before these pieces, and the pieces."""
        self._memory, self._age = Memory(z, covariance, self._coordinates.spread), 0.0
        for piece in pieces:
            self._memory.add(piece, self.options.memory_s)
        self._white.clear()
        self._since.clear()
        self._suspended = self._change = None
        self._unexplained, self._lost_s = 0, 0.0

    def _begin_anew(self) -> None:
        """Forget all: the first windows disagree with each other, so the first fit found a wrong minimum."""
        self._memory = self._last = self._suspended = self._change = None
        self._stop_tracking()
        self._fit_next = -np.inf

    def _suspend(self) -> None:
        """Fit the newest windows by themselves: no change of parameters explains the newest samples."""
        self._fit_next = -np.inf
        self._suspended = self._last
        self._change = None
        self._since.clear()
        self._unexplained = 0

    # --- fits of whole windows

    @property
    def _options(self) -> Innovations:
        assert isinstance(self.estimator, Innovations)
        return self.estimator

    def _alone(self) -> Estimate:
        """Fit the window without a memory."""
        recording = self._recent.recording()
        if not isinstance(self.estimator, Innovations):
            return self.estimator.fit(self.model, recording, self.settings)
        estimate = fit_innovations(self.model, recording, self.settings, self._options, previous=self._last)
        if estimate.converged:
            self._last = estimate
        return estimate

    def _estimate(self) -> Estimate:
        """Return the estimate at a hop."""
        end = self._recent.end
        if not self.moving:
            return self._resting()
        if self._memory is None or self._suspended is not None:
            if self._window.duration < self.options.window_s - 2.0 * STILL_S and self._suspended is None:
                return self._too_short()
            if self._suspended is not None and end < self._fit_next:
                return with_note(self._suspended, self._window)
            self._fit_next = end + AGAIN_S
            return self._started()
        assert self._last is not None
        if self._change is not None or self._lost_s > self.options.window_s:
            return with_note(self._last, self._window)
        if self._resumed and not self._memory.blocks:
            return self._known(Status.TOO_SHORT, UNTESTED)
        self._check()
        white = np.concatenate(self._white) if self._white else None
        return published(self.model, self._last, self._coordinates, self._now(), self._window, white, self._changes)

    def _too_short(self) -> Estimate:
        recording = self._window.recording()
        text = (
            f"{recording.source}: the joint has moved for {self._window.duration:.2g} s, "
            f"a first estimate needs {self.options.window_s:g} s of motion: move the joint"
        )
        return unusable(self.model, "innovations", UnusableError(Status.TOO_SHORT, text), recording)

    def _now(self) -> tuple[Array, Array]:
        """Return estimate and covariance with the samples of the present block."""
        memory, block = self._memory, self._block
        assert memory is not None
        if block is None:
            return memory.mean, memory.covariance
        mean = np.asarray(np.linalg.solve(memory.matrix + block.matrix, memory.vector + block.vector), dtype=float)
        covariance = memory.covariance_with(block.matrix)
        away = np.abs(mean - block.z)
        if np.any((away > LINEAR * self._coordinates.unit) & (away > np.sqrt(np.diag(covariance)))):
            return memory.mean, memory.covariance  # too far for one linear step: wait for the end of the block
        return mean, covariance

    def _started(self) -> Estimate:
        """Fit the window as a whole and begin a memory with it."""
        recording = self._window.recording()
        known = self._suspended is not None
        estimate = fit_innovations(self.model, recording, self.settings, self._options, previous=self._last)
        if not estimate.converged:
            if known:
                self._suspended = estimate
            return estimate
        self._last = estimate
        self._changes = ()
        self._stop_tracking()
        after = Belief.after(estimate, self._coordinates)
        tracker = self._tracker_of(recording, after.mean)
        pieces = None if tracker is None else tracker.start()
        if tracker is not None and pieces:
            before = Belief.before_data(tracker.data, self._coordinates)
            self._remember(before.mean, np.asarray(np.linalg.inv(before.precision)), pieces)
            self._shows_rest = seen_by(tracker.data.labels, tracker.data.y, tracker.data.period, estimate.noise)
            if not tracker.data.rest[-1]:
                self._tracker = tracker
            self._refine() if self._tracker is not None else None
        else:
            self._remember(after.mean, np.asarray(np.linalg.inv(after.precision)), [])
        self._check_next = self._window.end + CHECK_AFTER[0] * self.options.window_s
        self._checks = 0
        if known:
            notes = (estimate.notes[0], "The joint has changed: what was known is forgotten.", *estimate.notes[1:])
            return replace(estimate, message=message(notes), notes=notes)
        return estimate

    def _check(self) -> None:
        """Fit the newest window by itself beside the recursion, for its noise levels and tests."""
        if self._checking is not None and self._checking.done():
            self._checked(self._checking.result())
            self._checking = None
        window_s = self.options.window_s
        if self._checking is not None or self._window.end < self._check_next:
            return
        if not self.moving:
            return
        self._checks += 1
        length = CHECK_AFTER[self._checks] if self._checks < len(CHECK_AFTER) else CHECK_EVERY
        self._check_next = self._window.end + length * window_s
        job = partial(
            fit_innovations, self.model, self._window.recording(), self.settings, self._options, previous=self._last
        )
        if self._background is None:
            self._checked(job())
        else:
            self._checking = self._background.submit(job)

    def _checked(self, estimate: Estimate) -> None:
        """Take noise levels and findings of a window that was fitted by itself."""
        last, memory, doubt = self._last, self._memory, self._doubt
        self._doubt = False
        assert last is not None
        if memory is None or self._suspended is not None or self._change is not None:
            return
        if doubt and not (estimate.converged and agree(estimate, memory, self._coordinates)):
            self._suspend()
            return
        own = 1.0 if doubt else OWN_SHARE
        if not estimate.converged or estimate.free != last.free or set(estimate.noise) != set(last.noise):
            return
        noise = {
            n: float(np.exp((1.0 - own) * np.log(last.noise[n]) + own * np.log(estimate.noise[n]))) for n in last.noise
        }
        self._last = replace(estimate, noise=noise)
        if self._tracker is not None:
            self._tracker.levels = np.square([noise[n] for n in self._tracker.data.noise_names])

    def _resting(self) -> Estimate:
        recording = self._recent.recording()
        if self._last is None or self._memory is None:
            text = f"{recording.source}: {sentence('the joint rests in this window: move the joint')}"
            return unusable(self.model, "innovations", UnusableError(Status.NO_MOTION, text), recording)
        return self._known(Status.NO_MOTION, MOVING)

    def _known(self, status: Status, note: str) -> Estimate:
        """Return what is known, for the newest samples, which add nothing to it."""
        assert self._last is not None
        found = published(self.model, self._last, self._coordinates, self._now(), self._window, None, ())
        return replace(
            found, status=status, message=message((note,)), notes=(note,),
            start=self._recent.start, end=self._recent.end,
        )  # fmt: skip
