"""Simulation of many parameter sets and records at once, with exact sensitivities: the unrolled H-PINN."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.tensors.records import Records
from joint_id_core.tensors.torch_cell import Number, TorchCell, torch


def parameters(cell: TorchCell, p: Array, device: torch.device) -> list[Number]:
    """Return values p (B, P) as a list of P tensors of shape (B,); of a held one that all share, as a number.

    Numbers save operations. A free parameter never is one: Python would raise an error where a tensor becomes infinite.
    """
    shared = (p == p[0]).all(axis=0)
    return [
        float(column[0]) if same and name not in cell.sensitive else torch.from_numpy(column).to(device)
        for name, same, column in zip(cell.model.parameter_names, shared, np.ascontiguousarray(p.T), strict=True)
    ]


def index_of(records: Records, record: NDArray[np.int64] | None, batch: int) -> torch.Tensor | None:
    """Return which record each element of a batch takes, for `Records.sample`."""
    if records.count == 1:
        return None
    chosen = np.arange(batch) if record is None else np.asarray(record)
    return torch.from_numpy(chosen.astype(np.int64)).to(records.device)


@torch.no_grad()
def rollout(
    cell: TorchCell, records: Records, p: Array, x0: Array | None = None, record: NDArray[np.int64] | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Simulate every element of a batch, with the derivatives by the parameters `cell.sensitive`.

    Args:
        cell: from `torch_cell`.
        records: the inputs, and the integrator steps.
        p: values of all parameters, shape (B, P).
        x0: start states, shape (B, n); None takes those of the records.
        record: index of the record of each element, shape (B,); not needed if there is one, or one for each element.

    Returns:
        States (T, n, B) and their derivatives (T, n, k, B), on the device of the records.
    """
    B, index = len(p), index_of(records, record, len(p))
    c = cell.constants(parameters(cell, p, records.device))
    if x0 is None:
        start = records.x0.expand(-1, B) if index is None else records.x0.index_select(1, index)
    else:
        start = torch.from_numpy(np.ascontiguousarray(x0.T)).to(records.device)
    x = start.clone()
    W = x.new_zeros((cell.states, cell.parameters, B))
    X, J = x.new_empty((records.samples, *x.shape)), x.new_empty((records.samples, *W.shape))
    now = records.sample(0, records.row(0, index))
    for t in range(records.samples):
        X[t], J[t] = x, W
        if t + 1 < records.samples:
            then = records.sample(t + 1, records.row(t + 1, index))
            x = cell.step_columns(x, W, now.u, then.u, c, now.length, now.steps, records.most_at(t))
            now = then
    return X, J
