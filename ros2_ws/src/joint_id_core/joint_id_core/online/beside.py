"""What is done beside the recursion: fits of whole windows, of all samples since the start, and regressions."""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.checks import Background, WindowChecks
from joint_id_core.online.knowledge import Knowledge
from joint_id_core.online.lasting import Lasting
from joint_id_core.online.second_look import SecondLook, apart
from joint_id_core.online.second_opinion import SecondOpinion
from joint_id_core.online.stretch import Stretch
from joint_id_core.online.task import Task
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate


class Beside:
    """Looks at motion in other ways than the recursion does, from time to time.

    Args:
        model, settings: what is identified.
        window_s: length of the window in s.
        background: does the work.
        opinions: whether a second estimator is asked.
    """

    def __init__(
        self, model: Model, settings: ParameterSettings, window_s: float, background: Background, opinions: bool
    ) -> None:
        self._checks, self._look = WindowChecks(window_s, background), SecondLook(window_s, background)
        self._opinion = SecondOpinion(model, settings, window_s, background, opinions)
        self.stretch = Stretch(model, settings, window_s, background, opinions)

    def append(self, samples: Recording) -> None:
        """Add samples in motion."""
        self._look.append(samples)
        self._opinion.append(samples)
        self.stretch.append(samples)

    def begin(self, end: float) -> None:
        """Begin checks anew with a window that was fitted, its end in s; -inf lets the next one come at once."""
        self._checks.begin(end)

    def changed(self, end: float, changed_at: float) -> None:
        """Begin anew: the joint changed at an instant in s, and the newest window, its end in s, tells nothing."""
        self._checks.begin(end, changed_at)
        self.end_looks()
        self.forget_opinions()
        self.stretch.changed()

    def look_anew(self, samples: Recording) -> None:
        """Fit samples since the start again, of which these are the first."""
        self._look.begin(samples)

    def end_looks(self) -> None:
        """Fit the samples since the start no more."""
        self._look.end()

    def forget_opinions(self) -> None:
        """Begin second opinions anew: what was known of the joint is forgotten."""
        self._opinion.begin()

    def looked_again(self, known: Knowledge, task: Task, window: SlidingWindow, lasting: Lasting) -> Knowledge:
        """Fit all samples since the start, if it is time for that; begin anew with a fit that ends elsewhere."""
        follower = known.follower
        look = self._look.run(lambda recording: task.fit(recording, None), follower.tested_from)
        if look is None or not look.fit.converged or look.fit.free != known.last.free:
            return known
        if apart(look.fit, follower.now(), task.coordinates):
            tested, untested = follower.tested(look.samples)
            known = Knowledge.from_window(task, look.fit, tested, lasting, follower.age_s)
            if len(untested):
                known.follower.move(untested, window)
            self.begin(window.end)
        else:  # more samples show what a window hides, as a little play in the gear
            known.take(look.fit)
        return known

    def agrees(self, known: Knowledge, task: Task, window: SlidingWindow) -> bool:
        """Check the newest window, if it is time for that; return whether it agrees with what is known."""
        if known.follower.noise_changed:
            self._checks.ask()
        start = known.last
        if self._checks.due(window):  # from the values before a change, one search in ten ends elsewhere
            today = known.estimate(window)
            start = today if today.converged else start
        tested_from = known.follower.tested_from
        checked = self._checks.run(window, lambda recording: task.fit(recording, start), tested_from)
        return checked is None or known.agrees(checked)

    def judged(self, estimate: Estimate, tested_from: float) -> Estimate:
        """Return an estimate with the newest second opinion; see `SecondOpinion.on`."""
        return self._opinion.on(estimate, tested_from)
