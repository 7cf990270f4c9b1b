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
from joint_id_core.estimators import DEFAULT, Estimator, Regression, fit
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
SHARE = 0.05  # of a processor that these fits take at most; looks at newer motion beside them take as much at most
WHOLE = "No recursion describes this motion: this is a fit of the newest {:.0f} s of it as a whole."


class Stretch:
    """Keeps the newest motion, and fits it as a whole once the recursion has not described it for a window's length.

    That is if its estimates are poor fits, or of windows or estimators that disagree. It ends with a fit whose
    residuals show nothing that the model lacks: then the recursion fails for another reason, and says so. But if a
    computed load is matched to the motion, that is the reason. A sensor that is late is another reason: no fit is shown
    then, as its parameters would take up the delay.

    The first fit that converges is not shown before the next one describes its motion, too: slow motion at the
    beginning has another friction than what follows, and a load that is not known fits one stretch by chance. Where a
    fit takes long, and the next one has to wait, a regression looks meanwhile whether newer motion agrees with it.

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
        self._white = False  # whether the residuals of the newest fit show nothing
        self._fit: Estimate | None = None  # the newest one that describes its motion; not of a look
        self._waits_s = 0.0  # motion before the next fit; until then there are looks
        self._looks = False  # whether a look is running, or was the last
        self._motion = NewestMotion(REACH * self._window_s, LEAST * self._window_s)
        self._running: Future[tuple[Estimate, float]] | None = None
        self._described = False  # whether the newest fit of this motion, or look at it, describes it

    def changed(self) -> None:
        """Forget the motion before a change that the recursion tells, unless a fit of a stretch describes it."""
        if self._found is None and not self._described and self._proved:
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
            self._poor_since, self._found, self._white = np.inf, None, False
            return estimate
        poor = estimate.status in (Status.POOR_FIT, Status.DISAGREE)
        if poor and self._poor_since == np.inf:
            self._poor_since = estimate.end
            if self._proved:
                self._begin()
        asked = estimate.end >= self._poor_since + self._window_s
        if asked:
            self._update()
        if (asked and self._white and not self._matched) or not (asked or poor):
            self._poor_since, self._found, self._white = np.inf, None, False
        return estimate if self._found is None else self._found.updated(end=estimate.end)

    def at_rest(self, estimate: Estimate) -> Estimate:
        """Return what holds at rest: an estimate with the values of a stretch if these held in motion."""
        if self._found is None:
            return estimate
        said = {name: getattr(estimate, name) for name in ("status", "message", "notes", "end")}
        return self._found.updated(**said)

    def _update(self) -> None:
        """Take the newest fit, if one is ready; start another one if it is time for that."""
        if self._running is None and self._motion.due:
            self._looks = self._waits_s > 0.0
            estimator = Regression() if self._looks else DEFAULT
            fit_it = partial(_fitted, self._model, self._motion.recording(), self._settings, estimator)
            self._running = self._background(fit_it)
        if self._running is not None and self._running.done():
            (found, took_s), self._running = self._running.result(), None
            share_s, every_s = took_s / SHARE, EVERY * self._window_s
            wait_s = max(every_s, share_s) if self._looks else every_s
            self._waits_s = (self._waits_s if self._looks else share_s) - wait_s
            self._motion.wait(wait_s)
            self._found = self._shown(found)

    def _shown(self, found: Estimate) -> Estimate | None:
        """Return what is published after a fit, or a look; None if the recursion's estimate is."""
        before, self._described = self._described, found.status.describes
        judged = self._agreement.on(found) if found.status.describes else None
        if not self._looks:
            self._fit = judged
            checks = judged.checks if judged is not None and judged.converged else None
            self._white = checks is not None and not any(checks.texts)
        if judged is None or judged.status is Status.DISAGREE:
            return judged
        return self._fit if before else None


def _fitted(
    model: Model, recording: Recording, settings: ParameterSettings, estimator: Estimator
) -> tuple[Estimate, float]:
    """Fit a stretch as a whole; return the estimate, and the processor time in s."""
    begun = time.thread_time()
    found = fit(model, recording, settings, estimator)
    if not found.status.unusable:
        notes = (found.notes[0], WHOLE.format(found.end - found.start), *found.notes[1:])
        found = found.noted(notes, predictions=None)
    return found, time.thread_time() - begun
