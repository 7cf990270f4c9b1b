"""What a live page shows of the joints that are identified: the newest estimates and their course."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from joint_id_core.data.quantities import unit_text
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.pages.document import Page
from joint_id_core.pages.report import interval, prediction_plots, trend_plots, value_text
from joint_id_core.results.estimate import Estimate, Predictions, Status

MOST = 600  # points of a course; when there are more, every second one is left out
# Looks of a mark: what is right, what may be, what only waits for motion; all else is wrong.
LOOKS = {
    Status.CONVERGED: "good", Status.DISAGREE: "fair", Status.NO_MOTION: "idle", Status.TOO_SHORT: "idle",
    Status.UNINFORMATIVE: "idle",
}  # fmt: skip
ACTIONS = {"save": "Save what is known", "set_baseline": "Set as baseline", "reset": "Reset"}


@dataclass(frozen=True)
class Seen:
    """What was published of a joint last.

    Attributes:
        estimate: the newest good one, and how the newest window ended.
        age_s: of its parameters, against the newest window.
        changes, drifts: of its parameters, in words.
        baselines: values by parameter that has left its baseline.
    """

    estimate: Estimate
    age_s: float = 0.0
    changes: tuple[str, ...] = ()
    drifts: tuple[str, ...] = ()
    baselines: Mapping[str, float] = field(default_factory=dict)


class Course:
    """Values of the parameters of a joint over time, thinned so that it never grows beyond `MOST` points."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._time: list[float] = []
        self._rows: list[dict[str, tuple[float, float]]] = []
        self._every, self._skipped = 1, 0

    def __len__(self) -> int:
        return len(self._time)

    def add(self, time: float, estimate: Estimate) -> None:
        """Add the free parameters of an estimate at an instant in s.

        An instant that is not newer is left out; one before all others begins a new run.
        """
        if self._time and time < self._time[0]:
            self._begin()
        if self._time and time <= self._time[-1]:
            return
        self._skipped += 1
        if self._skipped < self._every:
            return
        self._skipped = 0
        self._time.append(time)
        self._rows.append({n: (estimate[n].value, estimate[n].std_dev) for n in estimate.free})
        if len(self._time) > MOST:
            self._time, self._rows, self._every = self._time[::2], self._rows[::2], 2 * self._every

    def arrays(self) -> tuple[Array, dict[str, tuple[Array, Array]]]:
        """Return instants (T,) in s before the newest one, and value and standard deviation (T,) by parameter."""
        time, rows = np.array(self._time, dtype=float), list(self._rows)
        nothing = (math.nan, math.nan)
        names = list(dict.fromkeys(name for row in rows for name in row))
        table = {n: np.array([row.get(n, nothing) for row in rows]).reshape(-1, 2) for n in names}
        return time - (time[-1] if len(time) else 0.0), {n: (t[:, 0], t[:, 1]) for n, t in table.items()}


class LiveView:
    """The joints of a robot as they are identified."""

    def __init__(self) -> None:
        self._seen: dict[str, Seen] = {}
        self._courses: dict[str, Course] = {}

    def take(self, joints: Mapping[str, Seen]) -> None:
        """Take what was published last; joints that are not in it are gone."""
        for name, seen in joints.items():
            self._courses.setdefault(name, Course())
            if seen.estimate.free:
                self._courses[name].add(seen.estimate.end, seen.estimate)
        self._courses = {name: course for name, course in self._courses.items() if name in joints}
        self._seen = dict(joints)

    def seen(self, joint: str) -> Seen:
        """Return what was published of a joint last.

        Raises:
            JointIdError: there is none of this name.
        """
        if joint not in self._seen:
            raise JointIdError(f"joint {joint!r} is not published: {', '.join(self._seen) or 'no joint'} is")
        return self._seen[joint]

    def joints(self, order: Sequence[str] = (), waited_s: float = 0.0) -> list[dict[str, Any]]:
        """Return a row of the page for each joint, in an order of names, then by name.

        Args:
            order: names of joints of the robot.
            waited_s: time since what was taken was published.
        """
        places = {name: k for k, name in enumerate(order)}
        names = sorted(self._seen, key=lambda name: (places.get(name, len(places)), name))
        return [self._row(name, self._seen[name], waited_s) for name in names]

    def plots(self, joint: str, window: Predictions | None) -> dict[str, Any]:
        """Return the plots of a joint: course of its parameters, and the fit of the newest window.

        Raises:
            JointIdError: as `seen`.
        """
        seen, (time, course) = self.seen(joint), self._courses[joint].arrays()
        trends = trend_plots(seen.estimate.parameters, time, course, "estimate", {"baseline": seen.baselines})
        fit = [] if window is None else list(prediction_plots(window, float(window.time[-1])))
        return {"trends": list(trends) if len(time) > 1 else [], "fit": fit}

    @staticmethod
    def _row(name: str, seen: Seen, waited_s: float = 0.0) -> dict[str, Any]:
        estimate = seen.estimate
        return {
            "joint": name, "model": estimate.model, "estimator": estimate.estimator, "status": estimate.status.value,
            "good": estimate.converged, "look": LOOKS.get(estimate.status, ""), "message": estimate.message,
            "age": round(seen.age_s + waited_s, 1),
            "temperature": f"{estimate.temperature:.1f}" if math.isfinite(estimate.temperature) else None,
            "alarms": [*seen.changes, *seen.drifts],
            "nrmse": {n: _number(v) for n, v in estimate.nrmse.items()},
            "parameters": parameter_rows(estimate),
        }  # fmt: skip


def parameter_rows(estimate: Estimate) -> list[list[str]]:
    """Return name, value, half of the 95 % interval, unit, verdict and reason of each parameter."""
    return [
        [p.name, value_text(p), interval(p), unit_text(p.unit), p.verdict.value, p.reason] for p in estimate.parameters
    ]


def live_page(title: str, actions: Sequence[str] = tuple(ACTIONS)) -> str:
    """Return the page that shows a `LiveView`, which it asks a `server.PageServer` for."""
    page = Page(title, ("parts.js", "live.js"))
    buttons = "".join(f'<button data-action="{name}">{ACTIONS[name]}</button>' for name in actions)
    page.head(
        f'<h1>{escape(title)} <span class="status" id="link">not connected</span></h1>',
        '<p class="message" id="told">Waiting for estimates.</p>',
        f'<p id="actions">{buttons} <span id="answer"></span></p>',
    )
    page.section("Changes and alarms", '<ul id="alarms"></ul>')
    page.section("Payload", '<p id="payload"></p>')
    page.section("Joints", '<div class="wide" id="joints"></div>')
    page.section(
        "Parameters",
        '<p class="hint" id="choice"><span id="choose">Choose a joint above.</span> '
        '<a id="report" target="_blank">Report of this joint</a></p>',
        '<p id="says"></p>',
        '<div class="wide" id="parameters"></div>',
    )  # fmt: skip
    page.section("Course", '<p class="hint">Time is that of the samples, before the newest.</p><div id="trends"></div>')
    page.section("Fit of the newest window", '<p class="hint" id="window"></p><div id="fit"></div>')
    page.section("Nodes", '<div class="wide" id="nodes"></div>')
    return page.html()


def _number(value: float) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None
