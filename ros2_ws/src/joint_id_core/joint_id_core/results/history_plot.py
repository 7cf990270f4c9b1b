"""Picture of the courses of parameters: a row a joint, a column a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.quantities import with_unit
from joint_id_core.results.history import Course
from joint_id_core.results.plot import require_writable, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDE = 1.96  # standard deviations, half of a 95 % interval


def save(path: Path, found: Sequence[Course]) -> None:
    """Save the picture of `figure`.

    Raises:
        JointIdError: as `plot.require_writable`, or the file cannot be written.
    """
    require_writable(path)
    written(path, figure(found))


def figure(found: Sequence[Course]) -> Figure:
    """Return a picture of values with 95 % intervals over days, or in the order of the files."""
    from matplotlib.figure import Figure

    joints = list(dict.fromkeys((c.robot, c.label) for c in found))
    rows = {joint: [c for c in found if (c.robot, c.label) == joint] for joint in joints}
    columns = max(map(len, rows.values()))
    drawn = Figure(figsize=(1.0 + 2.6 * columns, 0.6 + 2.2 * len(joints)), layout="constrained")
    axes = drawn.subplots(len(joints), columns, squeeze=False)
    for k, (joint, courses) in enumerate(rows.items()):
        for axis in axes[k, len(courses) :]:
            axis.set_visible(False)
        for axis, c in zip(axes[k], courses, strict=False):
            at = c.days if c.dated else np.arange(1, len(c.values) + 1)
            axis.errorbar(at, c.values, WIDE * c.std_devs, fmt="o", markersize=3, capsize=2, color="C0")
            axis.set_title(with_unit(c.name, c.unit), fontsize=9)
            axis.ticklabel_format(axis="y", useOffset=False)
            axis.tick_params(labelsize=8)
            axis.set_xlabel("days" if c.dated else "estimate", fontsize=8)
            if not c.dated:
                axis.xaxis.get_major_locator().set_params(integer=True)
        axes[k, 0].set_ylabel(" ".join(joint).strip())
    drawn.supxlabel("bars: 95 % intervals", fontsize=8, color="0.4")
    return drawn
