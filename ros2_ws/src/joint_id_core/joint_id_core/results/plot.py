"""Picture of a fit: labels and predictions, inputs, and parameters."""

from __future__ import annotations

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.quantities import known_digits, two_digits, unit_text
from joint_id_core.data.recording import Array
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate, Predictions
from joint_id_core.text_file import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED = "#b8c4cf"  # as pale as the line over it needs
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
    if not path.name:
        raise JointIdError(f"{path}: not the name of a picture: give one, such as fit.png")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise JointIdError(f"{path}: its folder {folder} does not exist: create it")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise JointIdError(f"{path}: no permission to write there: choose another folder or name")
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
    """Return a picture of every label with its prediction and their difference, of the inputs, and of the parameters.

    Of a training, the loss as well.

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

    rows = [2.0, 1.0] * len(shown.predicted) + [1.0] * len(shown.inputs)
    heights = [*rows, *([1.2] if estimate.losses else []), 0.22 * (len(estimate.parameters) + 1)]
    drawn = Figure(figsize=(9.0, 1.1 * sum(heights)), layout="constrained")
    axes = list(drawn.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0])
    over_time = axes[: len(rows)]
    _labels(over_time, shown)
    for axis, (name, values) in zip(over_time[2 * len(shown.predicted) :], shown.inputs.items(), strict=True):
        time, value = broken(shown.time - shown.time[0], values)
        axis.plot(time, value, linewidth=0.8, color="C2")
        axis.set_ylabel(f"input\n{_named(name)}")
    for axis in over_time:
        axis.sharex(over_time[0])
        axis.tick_params(labelbottom=axis is over_time[-1])
        axis.yaxis.label.set_size("small")
    drawn.align_ylabels(over_time)
    source = estimate.source.encode("utf-8", "replace").decode()  # a file name may be no text
    drawn.suptitle(f"{estimate.model} by {estimate.estimator}, {estimate.status.value}: {source}")
    over_time[-1].set_xlabel("time [s]")
    if estimate.losses:
        axes[-2].semilogy(np.arange(1, len(estimate.losses) + 1), estimate.losses, color="C4")
        axes[-2].set_ylabel("loss")
        axes[-2].set_xlabel("epoch")
    _parameters(axes[-1], estimate)
    return drawn


def _labels(axes: Sequence[Axes], shown: Predictions) -> None:
    """Draw labels and predictions, and the difference of each below."""
    for k, (name, found) in enumerate(shown.predicted.items()):
        time, measured, predicted = broken(shown.time - shown.time[0], shown.measured[name], found)
        above, below = axes[2 * k], axes[2 * k + 1]
        above.plot(time, measured, ".", markersize=6, markeredgewidth=0.0, color=MEASURED, label="measured")
        above.plot(time, predicted, linewidth=1.0, color="C3", label="predicted")
        above.set_ylabel(_named(name))
        if k == 0:
            above.legend(
                loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize="small", frameon=False, markerscale=1.5
            )
        below.plot(time, predicted - measured, linewidth=0.7, color="C0")
        below.set_ylabel("predicted -\nmeasured")
    if shown.horizon_s and shown.predicted:
        text = f"predictions begin anew at the filtered state every {shown.horizon_s:g} s, and errors grow from there"
        axes[1].set_title(text, fontsize="small", color="0.4")


def _parameters(axis: Axes, estimate: Estimate) -> None:
    """Write the parameters as a table."""
    axis.axis("off")
    rows = [
        [p.name, known_digits(p.value, p.std_dev), f"± {two_digits(p.std_dev)}" if np.isfinite(p.std_dev) else "",
         unit_text(p.unit), p.verdict.value]
        for p in estimate.parameters
    ]  # fmt: skip
    table = axis.table(
        rows, colLabels=["parameter", "value", "std dev", "unit", "verdict"], cellLoc="left", loc="center"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8.0)
    for cell in table.get_celld().values():
        cell.set_linewidth(0.3)


def _named(name: str) -> str:
    """Return a signal with its unit."""
    return f"{name.replace('_', ' ')} [{CHANNELS[name].unit if name in CHANNELS else 'rad'}]"


def written(path: Path, figure: Figure) -> None:
    """Write a picture, whole or not at all; the extension of its name sets the format.

    Raises:
        JointIdError: it cannot be written.
    """
    content = BytesIO()
    figure.savefig(content, dpi=120, format=path.suffix.lstrip(".").lower())
    write_bytes(path, content.getvalue(), "the picture")


def broken(time: Array, *rows: Array) -> tuple[Array, ...]:
    """Return instants (T,) and rows (T,) with a NaN in every gap, so that a line ends there."""
    steps = np.diff(time)
    at = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.intp)
    return tuple(np.insert(values, at, np.nan) for values in (time, *rows))
