"""Regressions of the newest motion beside the recursion, which check what it finds.

The recursion takes what the model lacks for white noise, as `innovations` does: see `estimators.cross_check`.
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace
from functools import partial

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.between_samples import fitted_between, takes_mean
from joint_id_core.estimators.cross_check import judged
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.opinion import Opinion, second_opinion, suits
from joint_id_core.estimators.shared.mean_drive import changes
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.checks import CHECK_AFTER, CHECK_EVERY, Background
from joint_id_core.online.newest_motion import NewestMotion
from joint_id_core.results.estimate import Estimate

REACH = 8.0  # lengths of the window in which friction and inertia are compared
AFTER_FAULT = 3.0  # the same of new motion, after which a motion that was not that of the model is asked for again


class SecondOpinion:
    """Keeps the newest motion, and asks for a second opinion on it from time to time.

    The answer waits until samples that follow the motion were tested, so that a change of the joint in it is known.

    Attributes:
        newest: the newest opinion; None before the first one, and if there is none for this model.

    Args:
        model, settings: what is identified. Where no second estimator suits the model, there are no opinions.
        window_s: length of the window in s.
        background: does the work.
        wanted: whether opinions are asked for at all.
    """

    def __init__(
        self, model: Model, settings: ParameterSettings, window_s: float, background: Background, wanted: bool = True
    ) -> None:
        self._model, self._settings = model, settings
        self._window_s, self._background, self._wanted = window_s, background, wanted and suits(model)
        self.newest: Opinion | None = None
        self.begin()

    def begin(self) -> None:
        """Begin anew: the joint has changed, or what was known of it is forgotten."""
        self.newest = None
        self._count, self._motion = 0, NewestMotion(REACH * self._window_s, CHECK_AFTER[0] * self._window_s)
        self._running: tuple[Future[Opinion | None], float] | None = None

    def _forget_motion(self) -> None:
        """Ask again soon, about new motion: what was wrong may have been in the samples, and may have ended."""
        self._motion = NewestMotion(REACH * self._window_s, AFTER_FAULT * self._window_s)

    def append(self, samples: Recording) -> None:
        """Add samples in motion."""
        if self._wanted:
            self._motion.append(samples)

    def on(self, estimate: Estimate, tested_from: float) -> Estimate:
        """Return an estimate with the newest opinion; ask for one if it is time for that.

        The newest stretch of samples that agreed with what is known began at `tested_from`, in s.
        """
        if self._running is None and self._wanted and self._motion.due:
            self._count += 1
            length = CHECK_AFTER[self._count] if self._count < len(CHECK_AFTER) else CHECK_EVERY
            self._motion.wait(length * self._window_s)
            ask = partial(_opinion, estimate, self._model, self._motion.recording(), self._settings)
            self._running = self._background(ask), self._motion.end
        if self._running is not None and tested_from >= self._running[1] and self._running[0].done():
            before, self.newest, self._running = self.newest, self._running[0].result(), None
            if self.newest is not None and (self.newest.fault or _newly_coloured(before, self.newest)):
                self._forget_motion()
        return estimate if self.newest is None else judged(estimate, self._model, self.newest)


def _newly_coloured(before: Opinion | None, newest: Opinion) -> bool:
    """Return whether the residual torque has a memory now, and had none before: a fault of a sensor does that, too."""
    return newest.coloured and before is not None and not before.coloured


def _opinion(estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings) -> Opinion | None:
    """Return the second opinion on an estimate; of a rigid joint also whether the drive was held.

    The regression is sure of that after long or fast motion only, the likelihood in most others, too.
    """
    opinion = second_opinion(estimate, model, recording, settings)
    if opinion is None or opinion.between or not takes_mean(model):
        return opinion
    fit = partial(fit_innovations, model, settings=settings)
    _, share = fitted_between(fit(recording), model, recording, fit)
    return replace(opinion, between=changes(model, share)) if share else opinion
