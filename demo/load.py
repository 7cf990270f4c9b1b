"""The joint that picks up a load: what the identifier said of it, and its two panels of the picture."""

from __future__ import annotations

import math
import re

import numpy as np
from live import STATUSES, History
from matplotlib.axes import Axes

from joint_id_core.data.recording import Array
from joint_id_msgs.msg import JointEstimate

INERTIA = "J_q"  # of the link, with what it holds
CHANGED = re.compile(rf"Changed: {INERTIA} from \S+ ± \S+ to \S+ ± [\d.e+-]*\d")
Z_95 = 1.96  # standard deviations to either side that hold 95 %
NEAR = 0.01  # relative error of an estimate that is right, and the largest one that the second panel shows
BLUE, ORANGE, RED = "#1f5fa8", "#d9730d", "#b3261e"


def report(history: History) -> str:
    """When the estimate was right again, and what the identifier said of the change."""
    time, value, _, good = _course(history)
    near = np.abs(value / history.truth[INERTIA] - 1.0) < NEAR
    right = np.flatnonzero(good & near & (time > history.changed_s))
    if not right.size:
        return f"  {INERTIA} changed after {history.changed_s:.1f} s of motion, and no estimate was right after that"
    said = _said(history)
    return (
        f"  {INERTIA} changed after {history.changed_s:.1f} s of motion; "
        f"{time[right[0]] - history.changed_s:.1f} s later the estimate was within {NEAR:.0%}.\n"
        f"  The identifier says: {said[1] if said else 'nothing of a change'}"
    )


def followed(panel: Axes, history: History) -> None:
    """The estimates with their 95 % band beside the truth, those of a poor fit marked, and what was said."""
    time, value, half, good = _course(history)
    before, after = history.before[INERTIA], history.truth[INERTIA]
    _band(panel, time, value, half, good)
    poor = STATUSES[JointEstimate.POOR_FIT]
    panel.plot(time[~good], value[~good], "x", color=RED, markersize=7, label=f"{poor}: the last good value stays")
    end = float(time[-1])
    panel.plot(
        [0.0, history.changed_s, history.changed_s, end], [before, before, after, after],
        color=ORANGE, linewidth=1.3, linestyle="--", label="truth",
    )  # fmt: skip
    if said := _said(history):
        k = int(np.searchsorted(time, said[0]))
        lines = said[1].replace(" from ", "\nfrom ").replace(" to ", "\nto ")
        panel.annotate(
            f"“{lines}”", (time[k], value[k]), xytext=(time[k], before + 0.35 * (after - before)),
            ha="center", va="center", fontsize=9, arrowprops={"arrowstyle": "->", "color": "0.35"},
        )  # fmt: skip
    room = 0.25 * (after - before)
    panel.set(xlim=(0.0, end + 0.2), ylim=(before - room, after + room))
    panel.set_xlabel("motion [s]")
    panel.set_ylabel(f"{INERTIA} [kg m^2]")
    panel.legend(loc="upper left", fontsize=9, frameon=False)


def zoomed(panel: Axes, history: History) -> None:
    """The error of the same estimates in percent, with the 95 % band."""
    time, value, half, good = _course(history)
    truth = np.where(time < history.changed_s, history.before[INERTIA], history.truth[INERTIA])
    scale = 100.0 * NEAR
    error = 100.0 * (value / truth - 1.0)
    off = np.abs(error) > scale
    _band(panel, time, error, 100.0 * half / truth, good & ~off)
    marks = []
    for which, color, kind in ((good, BLUE, "change not seen yet"), (~good, RED, STATUSES[JointEstimate.POOR_FIT])):
        if np.any(off & which):
            at = np.sign(error[off & which]) * 0.93 * scale
            marks += panel.plot(time[off & which], at, "v", color=color, markersize=6, label=f"off scale, {kind}")
    panel.axhline(0.0, color=ORANGE, linewidth=1.3, linestyle="--")
    panel.axvline(history.changed_s, color="0.6", linewidth=0.8)
    panel.set(xlim=(0.0, float(time[-1]) + 0.2), ylim=(-scale, scale))
    panel.set_xlabel("motion [s]")
    panel.set_ylabel(f"error of {INERTIA} [%]")
    if marks:
        panel.legend(handles=marks, loc="lower left", fontsize=9, frameon=False)


def _course(history: History) -> tuple[Array, Array, Array, Array]:
    """Return time in s of motion, value, half width of the 95 % band, and whether the fit was good, shapes (T,)."""
    rows = [
        (history.time(e), p.value, Z_95 * p.std_dev, e.status == JointEstimate.CONVERGED)
        for e in history.estimates
        for p in e.parameters
        if p.name == INERTIA
    ]
    time, value, half, good = (np.array(column) for column in zip(*rows, strict=True))
    return time, value, half, good


def _band(panel: Axes, time: Array, value: Array, half: Array, good: Array) -> None:
    """Good estimates with their band; a poor fit interrupts both."""
    value = np.where(good, value, math.nan)
    panel.fill_between(time, value - half, value + half, color=BLUE, alpha=0.18, linewidth=0, label="95 % band")
    panel.plot(time, value, ".-", color=BLUE, linewidth=1.2, markersize=4, label="estimate")


def _said(history: History) -> tuple[float, str] | None:
    """Time of the first estimate that names the change, and its sentence; None if there is none."""
    for e in history.estimates:
        if found := CHANGED.search(e.message):
            return history.time(e), found[0]
    return None
