"""Inputs that are the last measured derivative of a motion, as they arrive: see `models.curved_inputs`."""

from __future__ import annotations

from copy import copy

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import Model
from joint_id_core.models.curved_inputs import EVEN, last_rates


class CurvedStream:
    """Does to samples as they arrive what `curved` does to a record.

    Args:
        model: whose inputs they are.
        before: recording that they go on.
    """

    def __init__(self, model: Model, before: Recording) -> None:
        self._rows = last_rates(model)
        self._before = np.full((1 + len(self._rows), 2), np.nan)  # instants and values of the newest two samples
        newest = [before.time[-2:], *(before[model.input_names[i]][-2:] for i in self._rows)]
        self._before[:, 2 - len(newest[0]) :] = newest

    def copy(self) -> CurvedStream:
        """Return one that goes on by itself."""
        other = copy(self)
        other._before = self._before.copy()
        return other

    def take(self, time: Array, signals: Array) -> None:
        """Change the inputs in the first rows of new samples (inputs + others, T)."""
        if len(self._rows):
            compile_shared().curve(signals, np.ascontiguousarray(time), self._rows, self._before, EVEN)
