"""The picture of the demo: predicted beside measured signals, a load that is picked up, how the estimates converged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from live import History, free
from load import BLUE, ORANGE, Z_95, followed, zoomed
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.innovations.filtered import filtered
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import Model
from joint_id_msgs.msg import JointEstimate, ParameterEstimate

AHEAD_S = 2.0  # how far the simulation runs ahead of the data
LEAD_S = 0.5  # data before that, from which the state at its start is filtered
SIGNALS = ("current", "motor_velocity", "link_velocity", "link_position")  # the first `PANELS` that were measured
PANELS = 3
COLUMNS = 5
VIEW = 4.0  # height of a panel of convergence, in half widths of the band at a quarter of the time
GREY = "0.62"


@dataclass(frozen=True)
class Prediction:
    """The end of a recording, and its simulation with an estimate.

    Attributes:
        time: s of motion, shape (T,).
        measured, simulated: by channel, shape (T,).
        learned_s: end of the estimate's window in s of motion.
    """

    time: Array
    measured: dict[str, Array]
    simulated: dict[str, Array]
    learned_s: float


def predict(model: Model, recording: Recording, history: History) -> Prediction:
    """Simulate the last `AHEAD_S` of a recording with the last estimate from before them.

    The state at their start is filtered from the data before; from there on the simulation sees the inputs only.
    A busy machine may have no estimate so early: then the last one is taken, and the picture tells its time.

    Raises:
        JointIdError: no estimate converged.
    """
    begin = float(recording.time[-1]) - AHEAD_S
    start = float(recording.time[0])  # the recording begins with the motion
    good = [e for e in history.estimates if e.status == JointEstimate.CONVERGED]
    if not good:
        raise JointIdError("no picture: no live estimate converged")
    estimate = ([e for e in good if history.time(e) <= begin - start] or good)[-1]
    held = {p.name for p in estimate.parameters} - set(estimate.free)
    values = {p.name: p.value for p in estimate.parameters}
    data = prepare(
        model, recording.window(begin - LEAD_S, np.inf), ParameterSettings(values, fixed=held, freed=estimate.free)
    )
    kernel = compile_model(model)
    noise = dict(zip(estimate.signal, estimate.noise_std, strict=True))
    found = filtered(data, kernel, noise, estimate.substeps)[0]
    k = int(np.searchsorted(data.time, begin))
    X = rollout(kernel, found.states[k], data.time[k:], data.u[k:], data.p, found.steps[k:])
    names = [n for n in SIGNALS if n in data.labels][:PANELS]
    measured = {n: data.y[k:, data.labels.index(n)] for n in names}
    simulated = {n: X[:, model.state_names.index(n)] for n in names}
    return Prediction(data.time[k:] - start, measured, simulated, history.time(estimate))


def draw(path: Path, model: Model, recording: Recording, history: History, load: History) -> None:
    """Save the picture; `load` are the estimates of the joint that picked up a load.

    Raises:
        JointIdError: no estimate converged, or the file cannot be written.
    """
    prediction = predict(model, recording, history)
    names = [p.name for p in free(history.estimates[-1])]
    rows = -(-len(names) // COLUMNS)
    figure = Figure(figsize=(13.0, 6.6 + 2.2 * rows), layout="constrained")
    parts: Any = figure.subfigures(3, 1, height_ratios=[3.2, 2.8, 2.3 * rows], hspace=0.04)
    above, middle, below = parts
    _fit(above.subplots(1, len(prediction.measured), squeeze=False)[0], prediction)
    above.suptitle(
        f"Fit: {AHEAD_S:g} s simulated from the inputs alone, with what was known after {prediction.learned_s:.1f} s",
        fontsize=12, fontweight="bold", x=0.01, ha="left",
    )  # fmt: skip
    wide, narrow = middle.subplots(1, 2, width_ratios=(1.7, 1.0))
    followed(wide, load)
    zoomed(narrow, load)
    for panel in (wide, narrow):
        _plain(panel)
    middle.suptitle(
        "A load is picked up: estimates of the inertia of the link, published while the joint moved", fontsize=12,
        fontweight="bold", x=0.01, ha="left",
    )  # fmt: skip
    panels = below.subplots(rows, COLUMNS, squeeze=False)
    for panel in panels.ravel()[len(names) :]:
        panel.set_visible(False)
    for name, panel in zip(names, panels.ravel(), strict=False):
        _convergence(panel, name, history)
        panel.set_xlim(0.0, float(recording.duration))
        panel.set_xlabel("motion [s]", fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    below.legend(handles, labels, loc="upper right", ncols=3, frameon=False, fontsize=10)
    below.suptitle(
        "Convergence: estimates published while the joint moved", fontsize=12, fontweight="bold", x=0.01, ha="left"
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110, facecolor="white")
    except OSError as error:
        raise JointIdError(f"{path}: the picture cannot be written: {error}") from None


def _fit(panels: np.ndarray, prediction: Prediction) -> None:
    for panel, (name, measured) in zip(panels, prediction.measured.items(), strict=True):
        simulated = prediction.simulated[name]
        panel.plot(prediction.time, measured, ".", markersize=3, color=GREY, label="measured")
        panel.plot(prediction.time, simulated, linewidth=1.3, color=BLUE, label="simulated")
        share = 100.0 * np.sqrt(np.nanmean((simulated - measured) ** 2)) / np.nanstd(measured)
        panel.set_title(f"rms error {share:.2g} % of the signal", fontsize=9, color="0.35", loc="right")
        panel.set_ylabel(f"{name.replace('_', ' ')} [{CHANNELS[name].unit}]")
        panel.set_xlabel("motion [s]")
        _plain(panel)
    panels[0].legend(loc="best", fontsize=9, frameon=False, markerscale=3)


def _convergence(panel: Axes, name: str, history: History) -> None:
    """One parameter over time with its 95 % band; the view is set by the band once the first estimates are past."""
    rows: list[tuple[float, ParameterEstimate]] = [
        (history.time(e), p) for e in history.estimates for p in e.parameters if p.name == name and p.std_dev > 0.0
    ]
    time = np.array([t for t, _ in rows])
    value, half = np.array([p.value for _, p in rows]), Z_95 * np.array([p.std_dev for _, p in rows])
    panel.fill_between(time, value - half, value + half, color=BLUE, alpha=0.18, linewidth=0, label="95 % band")
    panel.plot(time, value, ".-", color=BLUE, linewidth=1.2, markersize=4, label="estimate")
    truth = history.truth[name]
    panel.axhline(truth, color=ORANGE, linewidth=1.3, linestyle="--", label="truth")
    reach = max(VIEW * half[len(half) // 4] / 2.0, 1.1 * float(np.max(np.abs(value[len(half) // 4 :] - truth))))
    panel.set_ylim(truth - reach, truth + reach)
    panel.set_title(f"{name} [{rows[-1][1].unit}]", fontsize=10)
    panel.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useOffset=False)
    panel.locator_params(axis="y", nbins=4)
    _plain(panel)


def _plain(panel: Axes) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(color="0.92", linewidth=0.8)
    panel.set_axisbelow(True)
    panel.tick_params(labelsize=8)
