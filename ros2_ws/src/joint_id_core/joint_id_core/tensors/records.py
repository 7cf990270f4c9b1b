"""Records of one model as tensors, side by side, for the loops of `tensors`."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.tensors.record import Record
from joint_id_core.tensors.torch_cell import Number, torch


@dataclass(frozen=True)
class Sample:
    """One sample of all elements of a batch. Each entry is a tensor of shape (B,), or (1,) if all share one record."""

    u: Sequence[torch.Tensor]
    y: Sequence[torch.Tensor]
    length: torch.Tensor
    gap: torch.Tensor
    steps: Number
    weight: torch.Tensor


class Records:
    """Records with the same inputs and labels, as tensors on a device; shorter ones end with missing labels.

    Args:
        records: of one model.
        device: where the tensors are kept.

    Raises:
        JointIdError: no record, or records with different labels.
    """

    def __init__(self, records: Sequence[Record], device: torch.device) -> None:
        if not records:
            raise JointIdError("a batch needs at least one record")
        shapes = {(r.u.shape[1], r.y.shape[1]) for r in records}
        if len(shapes) > 1:
            raise JointIdError("the records of one batch must have the same inputs and labels: fit them in groups")
        self.device, self.count = device, len(records)
        self.inputs, self.labels = shapes.pop()
        self.samples = max(len(r.time) for r in records)
        table = np.zeros((self.samples, self.inputs + self.labels + 4, self.count))
        table[:, self.inputs : self.inputs + self.labels] = np.nan
        table[:, -2:] = 1.0
        for j, r in enumerate(records):
            T = len(r.time)
            columns = [r.u, r.y, np.diff(r.time, append=r.time[-1])[:, None], r.gap[:, None], r.steps[:, None]]
            table[:T, :, j] = np.concatenate([*columns, r.weight[:, None]], axis=1)
            table[T:, : self.inputs, j] = r.u[-1]  # held: the time does not go on
        steps, y = table[:, -2], table[:, self.inputs : self.inputs + self.labels]
        self.most = [int(n) for n in steps.max(axis=1)]
        self._even = [bool(row.min() == row.max()) for row in steps]
        self.missing: NDArray[np.bool_] = np.asarray(
            np.isnan(y).any(axis=2)
        )  # (T, labels): some element has no such label there
        self.weighted: NDArray[np.bool_] = np.asarray((table[:, -1] != 1.0).any(axis=1))  # (T,)
        self.gapped: NDArray[np.bool_] = np.asarray((table[:, -3] != 0.0).any(axis=1))
        self._table = torch.from_numpy(table).to(device)
        self.x0, self.Q_x = self._stacked([r.x0 for r in records]), self._stacked([r.Q_x for r in records])
        self.P0 = self._stacked([r.P0 for r in records])
        self.restarts: dict[int, tuple[torch.Tensor, torch.Tensor, torch.Tensor]] = {}
        for t in sorted({t for r in records for t in r.restarts}):
            known = [r.restarts.get(t) for r in records]
            none = np.zeros_like(records[0].x0)
            means = self._stacked([none if k is None else k[0] for k in known])
            variances = self._stacked([none if k is None else k[1] for k in known])
            self.restarts[t] = (self._stacked([np.array(k is not None) for k in known]), means, variances)

    def _stacked(self, arrays: Sequence[Array]) -> torch.Tensor:
        return torch.from_numpy(np.stack(arrays, axis=-1)).to(self.device)

    def row(self, t: int, index: torch.Tensor | None) -> torch.Tensor:
        """Return what the records `index` (B,) have of sample t; None if they share the one there is."""
        return self._table[t] if index is None else self._table[t].index_select(1, index)

    def sample(self, t: int, row: torch.Tensor) -> Sample:
        """Return a row with names; t: a sample at which the elements take as many steps."""
        u, y, rest = row.split([self.inputs, self.labels, 4])
        length, gap, steps, weight = rest.unbind(0)
        return Sample(u.unbind(0), y.unbind(0), length, gap, self.most[t] if self._even[t] else steps, weight)

    def kind(self, t: int) -> Hashable:
        """Return what decides which operations sample t needs; the numbers of its row do not."""
        known = bool(self.weighted[t]), bool(self.gapped[t]), *self.missing[t].tolist()
        return self.most[t], self._even[t], *known

    def most_at(self, t: int) -> int:
        """Return the largest number of steps from sample t; 0 if all elements take the same."""
        return 0 if self._even[t] else self.most[t]
