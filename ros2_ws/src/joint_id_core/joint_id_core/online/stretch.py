"""Fits of the newest motion as a whole, where the recursion does not describe it.

The recursion takes what the model lacks for white noise. Friction of a real robot is no straight line over the speed,
and the residual torque has a memory: what a second of motion says of the joint disagrees with the next one by many
standard deviations, though the joint is the same. A fit of a longer stretch, with all checks of `estimators.fit`, has
intervals that hold there.
"""

from __future__ import annotations

import time
from concurrent.futures import Future
from functools import partial

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.estimators.opinion import suits
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.agreement import Agreement
from joint_id_core.online.checks import Background
from joint_id_core.online.newest_motion import NewestMotion
from joint_id_core.results.estimate import Estimate, Status

# Lengths of the window. Of fits of real robots, those of 8 and 16 s had 95 % intervals of friction that contain the
# reference in 92 to 100 %; those of 4 s in 85 to 91 %, of 2 s in 66 to 90 %.
LEAST, REACH = 4.0, 8.0
EVERY = 2.0  # the same of new motion, after which a stretch is fitted again
SHARE = 0.05  # of a processor that these fits take at most
WHOLE = "No recursion describes this motion: this is a fit of the newest {:.0f} s of it as a whole."


class Stretch:
    """Keeps the newest motion, and fits it as a whole once the recursion has not described it for a window's length.

    That is if its estimates are poor fits, or of windows or estimators that disagree. It ends with a fit whose
    residuals show nothing that the model lacks: then the recursion fails for another reason, and says so. But if a
    computed load is matched to the motion, that is the reason. A sensor that is late is another reason: no fit is shown
    then, as its parameters would take up the delay.

    Args:
        model, settings: what is identified.
        window_s: length of the window in s.
        background: does the fits.
        wanted: whether there are such fits at all.
    """

    def __init__(
        self, model: Model, settings: ParameterSettings, window_s: float, background: Background, wanted: bool = True
    ) -> None:
        self._model, self._settings, self._window_s, self._background = model, settings, window_s, background
        self._wanted = wanted and suits(model)
        self._matched = False  # whether a fit matches the load to the motion, which the recursion does not
        self._poor_since = np.inf
        self._found: Estimate | None = None
        self._agreement = Agreement(model, REACH * window_s, self._wanted)
        self._begin()

    def _begin(self) -> None:
        self._motion = NewestMotion(REACH * self._window_s, LEAST * self._window_s)
        self._running: Future[tuple[Estimate, float]] | None = None

    def changed(self) -> None:
        """Forget the motion before a change that the recursion tells, unless a stretch is shown in its place."""
        if self._found is None and self._proved:
            self._begin()

    @property
    def _proved(self) -> bool:
        """Whether the recursion has described so much motion that it is the joint that changes if it does no more."""
        return self._motion.duration > LEAST * self._window_s

    def append(self, samples: Recording) -> None:
        """Add samples in motion."""
        if self._wanted:
            self._motion.append(samples)
            self._matched = samples.load_errors is not None

    def on(self, estimate: Estimate, of_late_sensor: bool = False) -> Estimate:
        """Return what holds in motion: an estimate of the recursion, or the fit of a stretch in its place."""
        if not self._wanted:
            return estimate
        if of_late_sensor:
            self._poor_since, self._found = np.inf, None
            return estimate
        poor = estimate.status in (Status.POOR_FIT, Status.DISAGREE)
        if poor and self._poor_since == np.inf:
            self._poor_since = estimate.end
            if self._proved:
                self._begin()
        asked = estimate.end >= self._poor_since + self._window_s
        found = self._newest() if asked else None
        white = found is not None and found.converged and found.checks is not None and not any(found.checks.texts)
        if (white and not self._matched) or not (asked or poor):
            self._poor_since, self._found = np.inf, None
        return estimate if self._found is None else self._found.updated(end=estimate.end)

    def at_rest(self, estimate: Estimate) -> Estimate:
        """Return what holds at rest: an estimate with the values of a stretch if these held in motion."""
        if self._found is None:
            return estimate
        said = {name: getattr(estimate, name) for name in ("status", "message", "notes", "end")}
        return self._found.updated(**said)

    def _newest(self) -> Estimate | None:
        """Return the newest fit; start another one if it is time for that."""
        if self._running is None and self._motion.due:
            self._running = self._background(partial(_fitted, self._model, self._motion.recording(), self._settings))
        if self._running is not None and self._running.done():
            (found, took_s), self._running = self._running.result(), None
            self._motion.wait(max(EVERY * self._window_s, took_s / SHARE))
            self._found = self._agreement.on(found) if found.status.describes else None
        return self._found


def _fitted(model: Model, recording: Recording, settings: ParameterSettings) -> tuple[Estimate, float]:
    """Fit a stretch as a whole; return the estimate, and the processor time in s."""
    begun = time.thread_time()
    found = fit(model, recording, settings)
    if not found.status.unusable:
        notes = (found.notes[0], WHOLE.format(found.end - found.start), *found.notes[1:])
        found = found.noted(notes, predictions=None)
    return found, time.thread_time() - begun
