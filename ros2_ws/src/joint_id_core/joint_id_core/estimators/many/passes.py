"""Passes of the innovations form for a batch: by the compiled kernel one after the other, or by torch side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.recursion import NoiseInformation, Pass, Recursion
from joint_id_core.tensors.record import Record

DEVICES = ("cpu", "cuda", "torch")
# Memory of one call of the batched filter; larger batches are cut. On a CPU small parts stay in its cache.
CUDA_BYTES, CPU_BYTES = 2**31, 2**24
NOTHING = np.empty((0, 0))

Indices = NDArray[np.int64]


class Passes(Protocol):
    """Runs passes at many points."""

    def run(self, record: Indices, free: Array, levels: Array) -> Iterator[Pass]:
        """Return a pass for each element of a batch, with what it says of the noise levels, but without its path.

        Args:
            record: index of the record, shape (B,).
            free: physical values of the free parameters, shape (B, k).
            levels: noise variances, shape (B, L).
        """


def require_device(device: str, cell: str) -> None:
    """Check, before a long fit, that passes can run there.

    Raises:
        JointIdError: an unknown device, or one that is not there; torch is not installed, or has no such cell.
    """
    if device not in DEVICES:
        raise JointIdError(f"unknown device {device!r}: choose one of {', '.join(DEVICES)}")
    if device != "cpu":
        from joint_id_core.tensors.torch_cell import device_of  # loads torch

        device_of("cpu" if device == "torch" else device)
        if cell != "rk4":
            raise JointIdError(f"torch has no {cell} cell: choose the rk4 cell")


def passes_on(device: str, recursions: Sequence[Recursion], steps: Sequence[Steps]) -> Passes:
    """Return what runs passes of `recursions` with these integrator steps, each (T,), on a device.

    Errors: see `require_device` and `TorchPasses`.
    """
    return KernelPasses(recursions, steps) if device == "cpu" else TorchPasses(recursions, steps, device)


class KernelPasses:
    """Passes by the compiled kernel, one after the other."""

    def __init__(self, recursions: Sequence[Recursion], steps: Sequence[Steps]) -> None:
        self.recursions, self.steps = recursions, steps

    def run(self, record: Indices, free: Array, levels: Array) -> Iterator[Pass]:
        """Run the passes: see `Passes`."""
        for r, values, variances in zip(record.tolist(), free, levels, strict=True):
            recursion = self.recursions[r]
            last = recursion.run(values, variances, self.steps[r])
            known = recursion.noise_information(last) if np.isfinite(last.cost) else None
            yield _light(last.cost, last.hessian, last.gradient, values, variances, self.steps[r], known)


class TorchPasses:
    """Passes by torch, side by side: records of one model with the same free parameters and labels.

    Args:
        recursions: the records.
        steps: integrator steps of each, shape (T,).
        device: "cuda" or "torch".
        weights: how often each sample of a record counts, above zero, shape (records, T); None: once.

    Raises:
        JointIdError: records that differ in these; a device that is not there; torch is not installed.
    """

    def __init__(
        self,
        recursions: Sequence[Recursion],
        steps: Sequence[Steps],
        device: str = "torch",
        weights: Array | None = None,
    ) -> None:
        from joint_id_core.tensors.filter import InnovationsFilter  # loads torch, as the next
        from joint_id_core.tensors.records import Records
        from joint_id_core.tensors.torch_cell import device_of, torch_cell

        first = recursions[0]
        for other in recursions:
            if (other.data.model, other.data.free, other.data.labels) != (
                first.data.model, first.data.free, first.data.labels,
            ):  # fmt: skip
                raise JointIdError(
                    f"{other.data.recording.source}: a batch holds one model, with the same free parameters and labels"
                )
        self.recursions, self.steps = recursions, steps
        place = device_of("cpu" if device == "torch" else device)
        each = [None] * len(recursions) if weights is None else weights
        records = [record_of(r, s, w) for r, s, w in zip(recursions, steps, each, strict=True)]
        kept = Records(records, place)
        self.filter = InnovationsFilter(
            torch_cell(first.data.model, "tanh", first.data.free), kept, first.data.label_states
        )
        limit = CPU_BYTES if place.type == "cpu" else CUDA_BYTES
        self.most = max(1, limit // self.filter.bytes_each())  # elements of one call

    def run(self, record: Indices, free: Array, levels: Array) -> Iterator[Pass]:
        """Run the passes: see `Passes`."""
        p = np.array([self.recursions[r].values(f) for r, f in zip(record.tolist(), free, strict=True)])
        for first in range(0, len(record), self.most):
            part = slice(first, first + self.most)
            sums = self.filter.run(p[part], levels[part], record[part])
            for b, r in enumerate(record[part].tolist()):
                scale = levels[first + b]
                known = NoiseInformation(
                    sums.score[b] * scale, sums.information[b] * np.outer(scale, scale), sums.cross[b] * scale
                )
                yield _light(
                    float(sums.cost[b]), sums.hessian[b], sums.gradient[b], free[first + b], scale, self.steps[r], known
                )


def record_of(recursion: Recursion, steps: Steps, weight: Array | None = None) -> Record:
    """Return what a pass of the batched filter needs of a recursion's record; weight (T,): see `TorchPasses`."""
    data = recursion.data
    counts = np.ones(len(data.time)) if weight is None else weight.copy()
    counts[data.settling] = 0.0
    return Record(
        data.time, data.u, data.y, data.gap, steps, counts, recursion.x0, recursion.P0, recursion.Q_x,
        recursion.restarts,
    )  # fmt: skip


def _light(
    cost: float, hessian: Array, gradient: Array, free: Array, levels: Array, steps: Steps,
    noise: NoiseInformation | None,
) -> Pass:  # fmt: skip
    """Return a pass without its path: thousands of them fit into memory."""
    return Pass(cost, NOTHING, NOTHING, hessian, gradient, NOTHING, free, levels, steps, noise)
