"""A picture of measurement, prediction and what is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate


def check(path: Path) -> None:
    """Say before a long fit that its picture could not be saved.

    Raises:
        JointIdError: matplotlib is not installed, or the folder or the ending of `path` is of no use.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError:
        raise JointIdError("--plot needs matplotlib, which is not installed: install it, or leave --plot out") from None
    if not path.absolute().parent.is_dir():
        raise JointIdError(f"{path}: its folder {path.absolute().parent} does not exist: create it")
    known = FigureCanvasAgg.get_supported_filetypes()
    if path.suffix.lower().lstrip(".") not in known:
        raise JointIdError(f"{path}: not a picture format: end it in one of {', '.join(sorted(known))}")


def save(path: Path, model: Model, recording: Recording, estimate: Estimate) -> None:
    """Draw every label with its prediction, and their difference below.

    Raises:
        JointIdError: no prediction to draw, or the file cannot be written.
    """
    from matplotlib.figure import Figure

    held = set(model.parameter_names) - set(estimate.free)
    data = prepare(model, recording, estimate.values, held, estimate.free)
    predictions = estimate.predictions or {}
    if not predictions:
        raise JointIdError(f"{recording.source}: the fit made no prediction, there is nothing to plot")
    time = data.time - data.time[0]
    figure = Figure(figsize=(9.0, 3.2 * len(predictions)), layout="constrained")
    axes = figure.subplots(2 * len(predictions), 1, sharex=True, squeeze=False, height_ratios=[2, 1] * len(predictions))
    for k, (name, predicted) in enumerate(predictions.items()):
        measured = data.y[:, data.labels.index(name)]
        unit = model.states[model.state_names.index(name)].unit
        above, below = axes[2 * k, 0], axes[2 * k + 1, 0]
        above.plot(time, measured, ".", markersize=2, color="0.6", label="measured")
        above.plot(time, predicted, linewidth=1, color="C0", label="predicted")
        above.set_ylabel(f"{name.replace('_', ' ')} [{unit}]")
        above.legend(loc="upper right")
        below.plot(time, np.asarray(predicted) - measured, linewidth=0.7, color="C3")
        below.set_ylabel(f"error [{unit}]")
    axes[0, 0].set_title(f"{model.name}, {estimate.status.value}: {recording.source}")
    axes[-1, 0].set_xlabel("time [s]")
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise JointIdError(f"{path}: the picture cannot be written: {error}") from None
