"""Picture of a planned motion: position, velocity, acceleration and jerk of every joint."""

from __future__ import annotations

from pathlib import Path

from joint_id_core.design.limits import PARTS, UNITS
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.results.plot import require_writable, written


def save(path: Path, trajectory: Trajectory) -> None:
    """Plot a motion over time, as a controller makes it between the samples.

    Raises:
        JointIdError: as `plot.require_writable`, or the file cannot be written.
    """
    require_writable(path)
    import numpy as np
    from matplotlib.figure import Figure

    state = trajectory.between(PARTS)
    time = np.linspace(0.0, trajectory.duration, len(state.position))
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = figure.subplots(len(state), 1, sharex=True)
    for axis, kind, values in zip(axes, state._fields, state, strict=True):
        axis.plot(time, values, linewidth=1.0, label=trajectory.names)
        axis.set_ylabel(f"{kind} [{UNITS[kind]}]", fontsize=9)
        axis.tick_params(labelsize=8)
    axes[0].legend(  # above the curves, which it would hide
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=min(6, len(trajectory.names)), fontsize=8, frameon=False
    )
    axes[-1].set_xlabel("time [s]", fontsize=9)
    written(path, figure)
