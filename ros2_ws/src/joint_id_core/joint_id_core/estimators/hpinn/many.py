"""Training of many H-PINNs at once: from many starts, on several records, side by side on tensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.hpinn.estimator import HPinn
from joint_id_core.estimators.hpinn.network import interval_of, label_weights, scale_of
from joint_id_core.estimators.hpinn.training import Labels, LearningRate, make_labels
from joint_id_core.estimators.shared.fit_data import FitData, prepare
from joint_id_core.estimators.shared.initial_state import start_state
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.tensors.record import Record
from joint_id_core.tensors.records import Records
from joint_id_core.tensors.rollout import index_of, parameters
from joint_id_core.tensors.torch_cell import TorchCell, device_of, torch, torch_cell


@dataclass(frozen=True)
class Trained:
    """Networks after training, R records times S starts.

    Attributes:
        names: of the trained parameters.
        starts, values: start and end of the parameters, SI units, shape (R, S, k); the end is the epoch of lowest loss.
        losses: lowest loss of each, shape (R, S); NaN where the first simulation was not finite.
    """

    names: tuple[str, ...]
    starts: Array
    values: Array
    losses: Array


def train_many(
    model: Model,
    recordings: Sequence[Recording],
    starts: Array,
    settings: ParameterSettings | None = None,
    estimator: HPinn | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
) -> Trained:
    """Train networks as `HPinn` does, all at once. A network that diverges stops; the others go on.

    Args:
        model: from `models.build`.
        recordings: of one or several joints, with the same channels.
        starts: start values of the free parameters in the model's order, SI units, shape (S, k).
        settings: values, fixed and freed parameters.
        estimator: options; `substeps` 0 is one step per sample here, as in the paper.
        device: "cpu" or "cuda" (a GPU).
        progress: called with a line of text after every epoch.

    Raises:
        JointIdError: misuse of names, values or shapes, data that cannot be fitted, a device that is not there.
    """
    options, tell = estimator or HPinn(), progress or (lambda _: None)
    every = [prepare(model, recording, settings) for recording in recordings]
    for data in every:
        if data.dropped:
            raise JointIdError(f"{data.recording.source}: {data.dropped} samples lack an input: cut the record there")
    free, count = every[0].free, len(starts)
    if starts.ndim != 2 or starts.shape[1] != len(free) or not count:
        raise JointIdError(
            f"starts have shape {starts.shape}: give a row a start, a column for each of {', '.join(free)}"
        )
    labels = [make_labels(data, options.torsion_label) for data in every]
    if len({one.names for one in labels}) > 1:
        raise JointIdError("the recordings of one batch must have the same labels: train them in groups")
    place = device_of(device)
    records = Records([_record(d, one, max(1, options.substeps)) for d, one in zip(every, labels, strict=True)], place)
    record = np.repeat(np.arange(len(every)), count)
    first = np.tile(starts, (len(every), 1))
    loss = _Loss(torch_cell(model, options.friction, free), records, labels, record)
    scale = np.array([[scale_of(model, n, v) for n, v in zip(free, row, strict=True)] for row in starts.tolist()])
    ends = np.array(
        [[interval_of(model, n, v, options.bounds) for n, v in zip(free, row, strict=True)] for row in starts.tolist()]
    )
    scale, lower, upper = (np.tile(a, (len(every), 1)) for a in (scale, ends[..., 0], ends[..., 1]))
    p = np.array([every[r].p for r in record])
    index = [model.parameter_names.index(n) for n in free]
    weight = torch.nn.Parameter(torch.from_numpy(first / scale))
    rates = LearningRate(options.learning_rate, options.decay_at, options.decay_factor)
    optimizer, schedule = rates.rmsprop(weight, options.epochs)
    values, lowest = first.copy(), np.full(len(first), np.nan)
    for epoch in range(options.epochs):
        p[:, index] = weight.detach().numpy() * scale
        found, slope = loss.at(p)
        better = ~(found >= lowest) & np.isfinite(found)
        values[better], lowest[better] = p[:, index][better], found[better]
        going = np.isfinite(found) & np.isfinite(slope).all(axis=1)
        tell(f"epoch {epoch + 1} of {options.epochs}, {np.count_nonzero(going)} networks go on")
        weight.grad = torch.from_numpy(np.where(going[:, None], slope * scale, 0.0))
        before = weight.detach().clone()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            moved = weight.clamp(torch.from_numpy(lower / scale), torch.from_numpy(upper / scale))
            weight.copy_(torch.where(torch.from_numpy(going)[:, None], moved, before))
    shape = (len(every), count)
    return Trained(free, first.reshape(*shape, -1), values.reshape(*shape, -1), lowest.reshape(shape))


def _record(data: FitData, labels: Labels, substeps: int) -> Record:
    """Return the inputs and the labels of a record."""
    x0, spread = start_state(data)
    T, n = len(data.time), len(x0)
    steps = np.full(T, substeps, dtype=np.int64)
    return Record(data.time, data.u, labels.y, np.zeros(T), steps, np.ones(T), x0, np.diag(spread**2), np.zeros(n), {})


class _Loss:
    """Weighted mean square error (paper Eq 3) of every element, and its slope by the parameters."""

    def __init__(self, cell: TorchCell, records: Records, labels: Sequence[Labels], record: NDArray[np.int64]) -> None:
        self.cell, self.records = cell, records
        self.index = index_of(records, record, len(record))
        # of the squared error of each label: Eq 2, over the number of its samples and over the number of labels
        pull = [label_weights(one.y) ** 2 / np.isfinite(one.y).sum(0) / one.y.shape[1] for one in labels]
        self.pull = torch.from_numpy(np.stack(pull, axis=-1)[:, record]).to(records.device)
        self.mix = torch.from_numpy(labels[0].mix).to(records.device)
        self.states = [int(i) for i in labels[0].states]

    @torch.no_grad()
    def at(self, p: Array) -> tuple[Array, Array]:
        """Return losses (B,) and their slopes (B, k) at parameters p (B, P)."""
        cell, records, B = self.cell, self.records, len(p)
        c = cell.constants(parameters(cell, p, records.device))
        start = records.x0.expand(-1, B) if self.index is None else records.x0.index_select(1, self.index)
        x = start.clone()
        W = x.new_zeros((cell.states, cell.parameters, B))
        loss, slope = x.new_zeros(B), x.new_zeros((cell.parameters, B))
        now = records.sample(0, records.row(0, self.index))
        for t in range(records.samples):
            error = self.mix @ x[self.states] - torch.stack([y.expand(B) for y in now.y])
            if records.missing[t].any():
                error = torch.where(torch.isfinite(torch.stack([y.expand(B) for y in now.y])), error, 0.0)
            pulled = self.pull * error
            loss += (pulled * error).sum(0)
            slope += 2.0 * torch.einsum("ls,lb,skb->kb", self.mix, pulled, W[self.states])
            if t + 1 < records.samples:
                then = records.sample(t + 1, records.row(t + 1, self.index))
                x = cell.step_columns(x, W, now.u, then.u, c, now.length, now.steps, records.most_at(t))
                now = then
        return loss.cpu().numpy(), np.ascontiguousarray(slope.T.cpu().numpy())
