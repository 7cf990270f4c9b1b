"""The innovations form for many parameter sets and records at once: `cell.loops.innovations` and `noise` on tensors.

The two loops run together and sums are taken on the way, so nothing is kept of a sample. The last dimension of every
tensor is the batch. An element whose path diverges becomes NaN; the others do not notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.tensors.records import Records, Sample
from joint_id_core.tensors.replay import Replay
from joint_id_core.tensors.rollout import index_of, parameters
from joint_id_core.tensors.torch_cell import Number, TorchCell, torch


@dataclass(frozen=True)
class Sums:
    """What a pass says of each element: see `estimators.innovations.recursion` (`Pass`, `NoiseInformation`).

    Derivatives are by the physical values of the parameters, and by the noise variances themselves.

    Attributes:
        cost: sum of e^2/S + log S, shape (B,); NaN where the path diverged.
        hessian, gradient: shapes (B, k, k) and (B, k).
        score, information, cross: of the noise levels, shapes (B, L), (B, L, L) and (B, k, L).
    """

    cost: Array
    hessian: Array
    gradient: Array
    score: Array
    information: Array
    cross: Array


class InnovationsFilter:
    """A batch of filters on `records`, whose labels are the states `label`; its `run` is one pass.

    Args:
        cell: the cell with smoothed friction.
        records: the data.
        label: index of the state that each label measures, shape (m,).
    """

    def __init__(self, cell: TorchCell, records: Records, label: Array) -> None:
        self.cell, self.records, self.label = cell, records, [int(i) for i in label]

    def bytes_each(self) -> int:
        """Return the memory that one more element needs."""
        n, k, nu, L = self.cell.states, self.cell.parameters, self.cell.inputs, len(self.label) + self.cell.inputs
        return 8 * (8 * n * (k + n + nu) + 3 * k * k + 5 * n * n * L + 3 * L * L + 2 * k * L)

    @torch.no_grad()
    def run(self, p: Array, levels: Array, record: NDArray[np.int64] | None = None) -> Sums:
        """Run one pass for every element of a batch.

        Args:
            p: values of all parameters, shape (B, P).
            levels: variances of the label noise and of the input noise, shape (B, L).
            record: index of the record of each element, shape (B,); see `rollout`.
        """
        return _Pass(self, p, levels, record).sums()


class _Pass:
    """The state of all filters of one pass."""

    def __init__(self, of: InnovationsFilter, p: Array, levels: Array, record: NDArray[np.int64] | None) -> None:
        self.cell, self.records, self.label = of.cell, of.records, of.label
        cell, records, B, device = self.cell, self.records, len(p), self.records.device
        self.index = index_of(records, record, B)
        self.c = cell.constants(parameters(cell, p, device))
        variances = torch.from_numpy(np.ascontiguousarray(levels.T)).to(device)
        m, n, k = len(self.label), cell.states, cell.parameters
        self.R, self.q = variances[:m], variances[m:]
        self.x, self.P, self.Q_x = (self._of_records(a, B).clone() for a in (records.x0, records.P0, records.Q_x))
        L = len(variances)
        self.W = self.x.new_zeros((n, k + n + cell.inputs, B))
        self.eye = torch.eye(n, dtype=torch.float64, device=device)[:, :, None]
        self.cost, self.gradient, self.hessian = (self.x.new_zeros((*shape, B)) for shape in ((), (k,), (k, k)))
        self.dx, self.dP = self.x.new_zeros((n, L, B)), self.x.new_zeros((n, n, L, B))
        self.score, self.information = self.x.new_zeros((L, B)), self.x.new_zeros((L, L, B))
        self.cross = self.x.new_zeros((k, L, B))

    def _of_records(self, a: torch.Tensor, B: int) -> torch.Tensor:
        return a.expand(*a.shape[:-1], B) if self.index is None else a.index_select(a.dim() - 1, self.index)

    def sums(self) -> Sums:
        """Run over time and return the sums."""
        records, index, replay = self.records, self.index, Replay(self.records.device)
        now = records.row(0, index)
        held = now
        for t in range(records.samples):
            restart = records.restarts.get(t)
            if restart is not None:
                held = self._restarted(restart, held, now)
            if t + 1 < records.samples:
                then = records.row(t + 1, index)
                replay.run(records.kind(t), partial(self._advance, t), held, now, then)
                held, now = now, then
        last = records.samples - 1
        self._correct(last, records.sample(last, now), records.sample(last, held).u)
        cost = torch.where(torch.isfinite(self.cost), self.cost, torch.nan)
        parts = [self.hessian, self.gradient, self.score, self.information, self.cross]
        return Sums(cost.cpu().numpy(), *(_first(part) for part in parts))

    def _advance(self, t: int, held: torch.Tensor, now: torch.Tensor, then: torch.Tensor) -> None:
        """Correct all filters by sample t and predict the next one, from rows of the records; all in place."""
        records = self.records
        sample = records.sample(t, now)
        self._correct(t, sample, records.sample(t, held).u)
        self._predict(t, sample, records.sample(t, then))

    def _restarted(
        self, restart: tuple[torch.Tensor, torch.Tensor, torch.Tensor], held: torch.Tensor, now: torch.Tensor
    ) -> torch.Tensor:
        """Start the state of some elements again; return the row whose inputs were held until now."""
        here, mean, variance = (self._of_records(part, self.x.shape[-1]) for part in restart)
        self.x.copy_(torch.where(here, mean, self.x))
        self.P.copy_(torch.where(here, self.eye * variance, self.P))
        for part in (self.W, self.dx, self.dP):
            part.masked_fill_(here, 0.0)
        return torch.where(here[: now.shape[-1]], now, held)

    def _correct(self, t: int, now: Sample, held: Sequence[torch.Tensor]) -> None:
        """Correct all filters by the labels of one sample, one label after the other."""
        k, volume = self.cell.parameters, torch.ones_like(self.cost)
        weighted, squares = bool(self.records.weighted[t]), torch.zeros_like(self.cost)
        if self.cell.delayed:
            shown, by_x, by_p = self.cell.observe(self.x, held, now.u, self.c)
            at = self.x.clone()
        for j, i in enumerate(self.label):
            if self.cell.delayed:
                C = by_x[i]
                expected = shown[i] + (C * (self.x - at)).sum(0)
                seen = (self.P * C).sum(1)
                S = self.R[j] + (C * seen).sum(0)
                s = by_p[i] + (C[:, None] * self.W[:, :k]).sum(0)
                dP_i = (self.dP * C[:, None]).sum(1)
                dS, de = (C[:, None] * dP_i).sum(0), -(C[:, None] * self.dx).sum(0)
            else:
                expected, seen, S, s = self.x[i], self.P[:, i].clone(), self.P[i, i] + self.R[j], self.W[i, :k].clone()
                dP_i = self.dP[:, i].clone()
                dS, de = dP_i[i].clone(), -self.dx[i]
            dS[j] += 1.0
            S = torch.where(S > 0.0, S, torch.nan)
            inverse = 1.0 / S
            error = now.y[j] - expected
            if self.records.missing[t, j]:
                there = torch.isfinite(now.y[j])
                error, inverse = torch.where(there, error, 0.0), torch.where(there, inverse, 0.0)
                S = torch.where(there, S, 1.0)
            gain = seen * inverse
            z = error * inverse  # of the label, over S
            squares.addcmul_(z, error)
            volume *= S
            self._add(s, dS, de, z, inverse, now.weight if weighted else None)
            if weighted:  # a label that tells the state only does not move the levels
                z = torch.where(now.weight > 0.0, z, 0.0)
            self.dx.addcmul_(dP_i - gain[:, None] * dS, z).addcmul_(gain[:, None], de)
            self.dP.addcmul_(dP_i[:, None], gain[None, :, None], value=-1.0)
            self.dP.addcmul_(gain[:, None, None], dP_i[None] - gain[:, None] * dS, value=-1.0)
            self.x.addcmul_(gain, error)
            self.W[:, :k].addcmul_(gain[:, None], s, value=-1.0)
            if self.cell.delayed:
                half = gain[:, None] * seen
                self.P -= 0.5 * (half + half.transpose(0, 1))
            else:
                self.P.addcmul_(gain[:, None], seen, value=-1.0)
                # P (1 - K) with 1 - K = R / S: the difference 1 - K itself would lose its digits
                left = self.R[j] * inverse
                if self.records.missing[t, j]:
                    left = torch.where(there, left, 1.0)
                self.P[i] = self.P[:, i] = seen * left
        share = squares + torch.log(volume)
        self.cost += share * now.weight if weighted else share

    def _add(
        self,
        s: torch.Tensor,
        dS: torch.Tensor,
        de: torch.Tensor,
        z: torch.Tensor,
        inverse: torch.Tensor,
        weight: Number,
    ) -> None:
        """Add what one label says of the parameters and of the noise levels to the sums."""
        if weight is not None:
            z, inverse = z * weight, inverse * weight
            square = torch.where(weight > 0.0, z * z / weight, 0.0)
            half = torch.where(weight > 0.0, 0.5 * inverse * inverse / weight, 0.0)
        else:
            square, half = z * z, 0.5 * inverse * inverse
        self.gradient.addcmul_(s, z)
        weighed = s * inverse
        self.hessian.addcmul_(weighed[:, None], s)
        self.score.addcmul_(dS, 0.5 * (square - inverse)).addcmul_(de, z, value=-1.0)
        self.information.addcmul_((dS * half)[:, None], dS).addcmul_((de * inverse)[:, None], de)
        self.cross.addcmul_(weighed[:, None], de, value=-1.0)

    def _predict(self, t: int, now: Sample, then: Sample) -> None:
        """Advance all filters to the next sample."""
        n, k = self.cell.states, self.cell.parameters
        self.W[:, k:] = 0.0
        self.W[:, k : k + n] += self.eye
        most = self.records.most_at(t)
        self.x.copy_(self.cell.step_columns(self.x, self.W, now.u, then.u, self.c, now.length, now.steps, most))
        F, G = self.W[:, k : k + n], self.W[:, k + n :]
        self.P.copy_(_from_right(_from_left(F, self.P), F))
        self.dP.copy_(_from_right(_from_left(F, self.dP), F))
        self.dx.copy_(_from_left(F, self.dx))
        m = len(self.label)
        for i in range(self.cell.inputs):
            outer = G[:, i, None] * G[None, :, i]
            variance = self.q[i]
            if self.records.gapped[t]:
                variance = variance + now.gap * (then.u[i] - now.u[i]) ** 2
            self.P.addcmul_(outer, variance)
            self.dP[:, :, m + i] += outer
        for i in range(n):
            self.P[i, i] += self.Q_x[i]


def _first(part: torch.Tensor) -> Array:
    """Return a tensor as an array whose first dimension is the batch."""
    return np.ascontiguousarray(part.movedim(-1, 0).cpu().numpy())


def _from_left(F: torch.Tensor, M: torch.Tensor) -> torch.Tensor:
    """Return F M: F (n, n, B), M (n, ..., B)."""
    shape = (len(F), *[1] * (M.dim() - 2), F.shape[-1])
    product = F[:, 0].reshape(shape) * M[0]
    for k in range(1, len(F)):
        product.addcmul_(F[:, k].reshape(shape), M[k])
    return product


def _from_right(M: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
    """Return M F': M (n, n, ..., B), F (n, n, B)."""
    shape = (1, len(F), *[1] * (M.dim() - 3), F.shape[-1])
    product = M[:, 0, None] * F[:, 0].reshape(shape)
    for k in range(1, len(F)):
        product.addcmul_(M[:, k, None], F[:, k].reshape(shape))
    return product
