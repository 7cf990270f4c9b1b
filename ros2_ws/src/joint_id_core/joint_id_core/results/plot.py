"""Plot of measured and predicted labels and of their difference."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAP = 10.0  # steps of the typical length, from which no line is drawn across


def require_writable(path: Path) -> None:
    """Check, before a long fit, that its plot can be saved.

    Raises:
        JointIdError: matplotlib is not installed, the folder does not exist, the file extension is not a picture
            format, or the file cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError:
        raise JointIdError("a plot needs matplotlib, which is not installed: pip install matplotlib") from None
    folder = path.absolute().parent
    if not folder.is_dir():
        raise JointIdError(f"{path}: its folder {folder} does not exist: create it")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise JointIdError(f"{path}: cannot be written: choose another folder or name")
    known = FigureCanvasAgg.get_supported_filetypes()
    if path.suffix.lower().lstrip(".") not in known:
        raise JointIdError(f"{path}: not a picture format: end it in one of {', '.join(sorted(known))}")


def save(path: Path, estimate: Estimate) -> None:
    """Save the picture of `figure`.

    Raises:
        JointIdError: as `require_writable` and `figure`; the file cannot be written.
    """
    require_writable(path)
    written(path, figure(estimate))


def figure(estimate: Estimate) -> Figure:
    """Return a picture of every label with its prediction, and of their difference below.

    Raises:
        JointIdError: matplotlib is not installed; the estimate has no predictions.
    """
    shown = estimate.predictions
    if shown is None or not shown.predicted:
        raise JointIdError(f"the estimate of {estimate.model} holds no predictions, there is nothing to plot")
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise JointIdError("a plot needs matplotlib, which is not installed: pip install matplotlib") from None

    count = len(shown.predicted)
    drawn = Figure(figsize=(9.0, 3.2 * count), layout="constrained")
    axes = drawn.subplots(2 * count, 1, sharex=True, squeeze=False, height_ratios=[2, 1] * count)
    for k, (name, found) in enumerate(shown.predicted.items()):
        unit = CHANNELS[name].unit if name in CHANNELS else "rad"
        time, measured, predicted = broken(shown.time - shown.time[0], shown.measured[name], found)
        above, below = axes[2 * k, 0], axes[2 * k + 1, 0]
        above.plot(time, measured, ".", markersize=2, color="0.6", label="measured")
        above.plot(time, predicted, linewidth=1, color="C0", label="predicted")
        above.set_ylabel(f"{name.replace('_', ' ')} [{unit}]")
        above.legend(loc="upper right")
        below.plot(time, predicted - measured, linewidth=0.7, color="C3")
        below.set_ylabel(f"error [{unit}]")
    axes[0, 0].set_title(f"{estimate.model}, {estimate.status.value}: {estimate.source}")
    axes[-1, 0].set_xlabel("time [s]")
    return drawn


def written(path: Path, figure: Figure) -> None:
    """Write a picture.

    Raises:
        JointIdError: it cannot be written.
    """
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise JointIdError(f"{path}: the picture cannot be written: {error}") from None


def broken(time: Array, *rows: Array) -> tuple[Array, ...]:
    """Return instants (T,) and rows (T,) with a NaN in every gap, so that a line ends there."""
    steps = np.diff(time)
    at = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.intp)
    return tuple(np.insert(values, at, np.nan) for values in (time, *rows))
