"""Picture of the courses of parameters: a row a joint, a column a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from joint_id_core.results.history import Course
from joint_id_core.results.plot import require_writable, written

WIDE = 1.96  # standard deviations, half of a 95 % interval


def save(path: Path, found: Sequence[Course]) -> None:
    """Plot values with 95 % intervals over days, or in the order of the files.

    Raises:
        JointIdError: as `plot.require_writable`, or the file cannot be written.
    """
    require_writable(path)
    from matplotlib.figure import Figure

    joints = list(dict.fromkeys((c.robot, c.label) for c in found))
    rows = {joint: [c for c in found if (c.robot, c.label) == joint] for joint in joints}
    columns = max(map(len, rows.values()))
    figure = Figure(figsize=(1.0 + 2.6 * columns, 0.6 + 2.2 * len(joints)), layout="constrained")
    axes = figure.subplots(len(joints), columns, squeeze=False)
    for k, (joint, courses) in enumerate(rows.items()):
        for axis in axes[k, len(courses) :]:
            axis.set_visible(False)
        for axis, c in zip(axes[k], courses, strict=False):
            at = c.days if c.dated else np.arange(1, len(c.values) + 1)
            axis.errorbar(at, c.values, WIDE * c.std_devs, fmt="o", markersize=3, capsize=2, color="C0")
            axis.set_title(f"{c.name} [{c.unit}]", fontsize=9)
            axis.tick_params(labelsize=8)
            axis.set_xlabel("days" if c.dated else "estimate", fontsize=8)
            if not c.dated:
                axis.xaxis.get_major_locator().set_params(integer=True)
        axes[k, 0].set_ylabel(" ".join(joint).strip())
    written(path, figure)
