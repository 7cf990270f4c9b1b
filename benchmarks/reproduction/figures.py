"""The paper's figures 4, 6, 7 and 8 from our runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from joint_id_core.data.recording import Array
from reproduction.cases import Case
from reproduction.runs import predicted
from reproduction.study import Row

LABELS = {
    "current": "current, A",
    "motor_position": "motor position, rad",
    "link_position": "link position, rad",
    "motor_velocity": "motor velocity, rad/s",
    "link_velocity": "link velocity, rad/s",
}
LEAST = 1e-9  # error over the range of a course below which it is not drawn smaller, as a zero at the start


def _torsion(case: Case, states: Array) -> Array:
    names = case.model.state_names
    return 1e3 * (states[:, names.index("motor_position")] / case.truth["N"] - states[:, names.index("link_position")])


def _save(axes: Sequence[Axes], path: Path) -> None:
    for ax in axes:
        ax.grid(alpha=0.3)
    figure = axes[0].get_figure(root=True)
    assert figure is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def step(case: Case, path: Path) -> None:
    """Fig. 4: the simulated step response."""
    _, grid = plt.subplots(2, 3, figsize=(10, 5), layout="constrained")
    axes, t = list(grid.ravel()), case.recording.time
    for ax, name, values in zip(axes, case.model.state_names, case.states.T, strict=False):
        ax.plot(t, values)
        ax.set(ylabel=LABELS[name], xlabel="time, s")
    axes[5].plot(t, _torsion(case, case.states))
    axes[5].set(ylabel="torsion, mrad", xlabel="time, s")
    _save(axes, path)


def training(rows: Sequence[Row], path: Path) -> None:
    """Figs 6 and 7: the training loss of H-PINN, and by how much each method misses the states.

    The paper draws the states themselves, where the curves of all methods lie on each other.
    """
    case = rows[0].case
    names = list(case.model.state_names)
    flexible = "link_position" in names
    lines, columns = (2, 4) if flexible else (1, 4)
    _, grid = plt.subplots(lines, columns, figsize=(11, 3.2 * lines), layout="constrained")
    axes, t = list(np.ravel(grid)), case.recording.time
    for r in rows:
        if r.method == "H-PINN" and r.runs:
            axes[0].semilogy(r.best().loss)
    axes[0].set(xlabel="epoch", ylabel="training loss of H-PINN")
    known = _shown(case, case.states, flexible)
    for r in (r for r in rows if r.runs):
        states = _shown(case, predicted(case, r.best().values), flexible)
        for ax, found, true in zip(axes[1:], states, known, strict=False):
            ax.semilogy(t, np.maximum(np.abs(found - true), LEAST * float(np.ptp(true))), lw=1, label=r.method)
    for ax, label, true in zip(axes[1:], [*(LABELS[n] for n in names), "torsion, mrad"], known, strict=False):
        ax.set(ylabel=f"error of {label}", xlabel="time, s")
        ax.set_title(f"range {np.ptp(true):.3g}", fontsize=9)
    _legend(axes[1], axes[-1])
    for ax in axes[len(known) + 1 :]:
        ax.set_axis_off()
    _save(axes, path)


def _shown(case: Case, states: Array, flexible: bool) -> list[Array]:
    """Return the courses that are shown: the states, and the torsion of a joint with a spring."""
    return [*states.T, *([_torsion(case, states)] if flexible else [])]


def _legend(ax: Axes, place: Axes) -> None:
    place.legend(*ax.get_legend_handles_labels(), loc="center", fontsize=8, frameon=False)


def motion(rows: Sequence[Row], path: Path) -> None:
    """Fig. 8: velocities and accelerations of motor and link, and by how much each method misses them."""
    case = rows[0].case
    names, t = case.model.state_names, case.recording.time
    _, grid = plt.subplots(4, 2, figsize=(11, 10), layout="constrained", sharex=True)
    for k, side in enumerate(("motor", "link")):
        column = names.index(f"{side}_velocity")
        velocity = case.states[:, column]
        acceleration = np.gradient(velocity, t)
        grid[0, k].plot(t, case.recording[f"{side}_velocity"], "0.3", lw=1)
        grid[2, k].plot(t, acceleration, "0.3", lw=1)
        for r in (r for r in rows if r.runs and r.method != "EKF"):
            values = predicted(case, r.best().values)[:, column]
            grid[1, k].plot(t, values - velocity, lw=1, label=r.method)
            grid[3, k].plot(t, np.gradient(values, t) - acceleration, lw=1, label=r.method)
        grid[0, k].set(ylabel=f"{side} velocity,\nrad/s, measured")
        grid[1, k].set(ylabel="error of it, rad/s")
        grid[2, k].set(ylabel=f"{side} acceleration,\nrad/s², without noise")
        grid[3, k].set(ylabel="error of it, rad/s²", xlabel="time, s")
    grid[1, 0].legend(fontsize=7)
    _save(list(grid.ravel()), path)
