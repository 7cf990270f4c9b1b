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
    """Figs 6 and 7: the training loss of H-PINN, and what each method predicts."""
    case = rows[0].case
    names = case.model.state_names
    flexible = "link_position" in names
    lines, columns = (2, 4) if flexible else (1, 3)
    _, grid = plt.subplots(lines, columns, figsize=(11, 3.2 * lines), layout="constrained")
    axes, t = list(np.ravel(grid)), case.recording.time
    for r in rows:
        if r.method == "H-PINN" and r.runs:
            axes[0].semilogy(r.best().loss)
    axes[0].set(xlabel="epoch", ylabel="training loss of H-PINN")
    for r in (r for r in rows if r.runs):
        states = predicted(case, r.best().values)
        for ax, values in zip(axes[1:], states.T, strict=False):
            ax.plot(t, values, "--", label=r.method)
        if flexible:
            axes[len(names) + 1].plot(t, _torsion(case, states), "--", label=r.method)
    for ax, name, values in zip(axes[1:], names, case.states.T, strict=False):
        ax.plot(t, values, "k", lw=1, alpha=0.6, label="data")
        ax.set(ylabel=LABELS[name], xlabel="time, s")
        low, high = float(values.min()), float(values.max())
        ax.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
    if flexible:
        twist = _torsion(case, case.states)
        axes[len(names) + 1].plot(t, twist, "k", lw=1, alpha=0.6, label="data")
        axes[len(names) + 1].set(ylabel="torsion, mrad", xlabel="time, s", ylim=(-0.3, 1.5 * float(twist.max())))
    axes[1].legend(fontsize=7)
    for ax in axes[len(names) + 1 + flexible :]:
        ax.set_axis_off()
    _save(axes, path)


def motion(rows: Sequence[Row], path: Path) -> None:
    """Fig. 8: velocities and accelerations of motor and link."""
    case = rows[0].case
    names, t = case.model.state_names, case.recording.time
    _, grid = plt.subplots(2, 2, figsize=(11, 6), layout="constrained", sharex=True)
    for k, side in enumerate(("motor", "link")):
        column = names.index(f"{side}_velocity")
        grid[0, k].plot(t, case.recording[f"{side}_velocity"], "0.6", lw=1, label="measured")
        grid[1, k].plot(t, np.gradient(case.states[:, column], t), "0.6", lw=1, label="without noise")
        for r in (r for r in rows if r.runs and r.method != "EKF"):
            values = predicted(case, r.best().values)[:, column]
            grid[0, k].plot(t, values, "--", lw=1, label=r.method)
            grid[1, k].plot(t, np.gradient(values, t), "--", lw=1, label=r.method)
        grid[0, k].set(ylabel=f"{side} velocity, rad/s")
        grid[1, k].set(ylabel=f"{side} acceleration, rad/s²", xlabel="time, s")
    grid[0, 0].legend(fontsize=7)
    _save(list(grid.ravel()), path)
