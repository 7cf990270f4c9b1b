"""The RK4 cell of a model on tensors: one step for every element of a batch, with exact derivatives.

The expressions are those of the compiled kernel (`cell.rk4_source`). Where the kernel reads a number, this cell reads a
tensor with a number for each element. Derivatives are carried forward, as in the kernel, so that the memory does not
grow with the length of a record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from joint_id_core.cell.rk4_source import point_text
from joint_id_core.cell.symbolic import Smoothing, derive
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model

try:
    import torch
except ImportError as error:
    raise JointIdError(
        "this needs PyTorch, which is not installed: pip install torch, or choose what runs without it (the estimator "
        "innovations)"
    ) from error

Entries = dict[tuple[int, int], Any]  # of a matrix: numbers, or tensors
Number = Any  # a number, or a tensor with one for each element of a batch
STAGES = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))  # share of the step and weight of the four stages


def device_of(name: str) -> torch.device:
    """Return the device called `name`.

    Raises:
        JointIdError: there is no such device here.
    """
    if name not in ("cpu", "cuda"):
        raise JointIdError(f"unknown device {name!r}: choose cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise JointIdError(
            "device cuda: PyTorch finds no GPU here: choose cpu, or install the GPU's driver and a PyTorch with CUDA"
        )
    return torch.device(name)


class _Functions:
    """The functions of `math` that generated lines call, for numbers and for tensors."""

    def __getattr__(self, name: str) -> Any:
        plain, batched = getattr(math, name), getattr(torch, name)

        def function(value: Number) -> Number:
            return batched(value) if isinstance(value, torch.Tensor) else plain(value)

        found = function if callable(plain) else plain
        setattr(self, name, found)
        return found


class TorchCell:
    """The cell of a model with derivatives by the parameters `sensitive`; see `torch_cell` for a cached one.

    States, inputs and parameters are lists of numbers or of tensors that broadcast to the shape of the batch.
    """

    def __init__(self, model: Model, friction: Smoothing, sensitive: tuple[str, ...]) -> None:
        self.model, self.sensitive = model, sensitive
        self.states, self.inputs, self.parameters = len(model.states), len(model.inputs), len(sensitive)
        self.delayed = bool(model.label_delays)
        names: dict[str, Any] = {"math": _Functions(), "sign": torch.sign}
        text = point_text(model, derive(model, friction, sensitive))
        exec(compile(text, f"<cell of {model.name}>", "exec"), names)
        self._constants, self._observe = names["constants"], names["observe"]
        self._inputs, self._slope, self._linearise = names["inputs"], names["slope"], names["linearise"]

    def constants(self, p: Sequence[Number]) -> dict[int, Number]:
        """Return what depends on the parameters alone; p: all parameters in the model's order."""
        c: dict[int, Number] = {}
        self._constants(p, c)
        return c

    def step(
        self,
        x: Sequence[Number],
        u0: Sequence[Number],
        u1: Sequence[Number],
        c: dict[int, Number],
        h: Number,
        substeps: Number = 1,
        most: int = 0,
    ) -> list[Number]:
        """Return the state one sample later, as new tensors, so that autograd can go through it.

        Args:
            x: state, a list of `states`.
            u0, u1: inputs at this sample and at the next, lists of `inputs`.
            c: from `constants`.
            h: time to the next sample in s.
            substeps: RK4 steps to the next sample.
            most: the largest of `substeps`, where these differ between the elements.
        """
        x, u, k = list(x), [0.0] * self.inputs, [0.0] * self.states
        for s in range(most or substeps):
            hs = _length(h, substeps, s, most)
            total = [0.0] * self.states
            for at, weight in STAGES:
                self._inputs(u0, u1, (s + at) / substeps, h, u)
                here = x if at == 0.0 else [b + at * hs * slope for b, slope in zip(x, k, strict=True)]
                self._slope(here, u, c, k)
                total = [r + weight * slope for r, slope in zip(total, k, strict=True)]
            x = [b + hs / 6.0 * r for b, r in zip(x, total, strict=True)]
        return x

    def step_columns(
        self,
        x: torch.Tensor,
        W: torch.Tensor,
        u0: Sequence[Number],
        u1: Sequence[Number],
        c: dict[int, Number],
        h: Number,
        substeps: Number = 1,
        most: int = 0,
    ) -> torch.Tensor:
        """Return the state one sample later, and advance its derivatives W in place.

        Args:
            x: state, shape (states, B).
            W: derivatives of the state, shape (states, columns, B): first those by the parameters `sensitive`. Where
                there are more columns, those by the state at the start of the sample and by the inputs follow.
            u0, u1, c, h, substeps, most: see `step`.
        """
        n, full = self.states, W.shape[1] > self.parameters
        u, f = [0.0] * self.inputs, [0.0] * n
        A, B, G, states = Entries(), Entries(), Entries(), Entries()
        none = x.new_zeros(x.shape[1])
        places = [(B, k) for k in range(self.parameters)]
        if full:
            places += [(states, 0)] * n + [(G, k) for k in range(self.inputs)]

        def dense(rows: list[list[Number]]) -> torch.Tensor:
            entries = [
                none if _zero(e) else e.expand_as(none) if isinstance(e, torch.Tensor) else none + e
                for row in rows
                for e in row
            ]
            return torch.stack(entries).view(n, -1, len(none))

        for s in range(most or substeps):
            hs = _length(h, substeps, s, most)
            k, D, slopes, sums = x, W, x, W  # set by the first stage
            for stage, (at, weight) in enumerate(STAGES):
                self._inputs(u0, u1, (s + at) / substeps, h, u)
                here, Y = (_plus(x, k, at * hs), _plus(W, D, at * hs)) if stage else (x, W)
                self._linearise(here.unbind(0), u, c, f, A, B, G)
                k = dense([[e] for e in f])[:, 0]
                slope = dense([[A[i, j] for j in range(n)] for i in range(n)])
                D = dense([[block.get((i, j), 0) for block, j in places] for i in range(n)])
                for j in range(n):
                    D.addcmul_(slope[:, j, None], Y[j])
                if stage:
                    slopes.add_(k, alpha=weight)
                    sums.add_(D, alpha=weight)
                else:
                    slopes, sums = k.clone(), D.clone()
            x = _plus(x, slopes, hs / 6.0)
            W.copy_(_plus(W, sums, hs / 6.0))
        return x

    def observe(
        self, x: torch.Tensor, held: Sequence[Number], u: Sequence[Number], c: dict[int, Number]
    ) -> tuple[list[Number], torch.Tensor, torch.Tensor]:
        """Return what sensors show of the state x (states, *batch) and its derivatives by state and parameters.

        `held` are the inputs until this sample, u those from now on. Only for models whose sensors have delays.

        Returns:
            A list of `states`, and tensors of shape (states, states, *batch) and (states, parameters, *batch).
        """
        n = self.states
        y, C, D = [0.0] * n, Entries(), Entries()
        self._observe(x.unbind(0), held, u, c, y, C, D)
        by_x, by_p = x.new_zeros((n, *x.shape)), x.new_zeros((n, self.parameters, *x.shape[1:]))
        for entries, full in ((C, by_x), (D, by_p)):
            for place, value in entries.items():
                if not _zero(value):
                    full[place] = value
        return y, by_x, by_p


def _zero(entry: Number) -> bool:
    return not isinstance(entry, torch.Tensor) and entry == 0


def _plus(base: torch.Tensor, change: torch.Tensor, factor: Number) -> torch.Tensor:
    """Return base + factor * change."""
    if isinstance(factor, torch.Tensor):
        return torch.addcmul(base, change, factor)
    return torch.add(base, change, alpha=factor)


def _length(h: Number, substeps: Number, s: int, most: int) -> Number:
    """Return the length of step s; it is zero for elements that have already taken all of theirs."""
    return torch.where(substeps > s, h / substeps, 0.0) if most else h / substeps


@lru_cache(maxsize=16)
def torch_cell(model: Model, friction: Smoothing = "tanh", sensitive: tuple[str, ...] | None = None) -> TorchCell:
    """Return the cell of a model; what SymPy derives for it is kept for the next call.

    It has derivatives by the parameters `sensitive`; None: by those that are not fixed in the model's table.
    """
    every = tuple(p.name for p in model.parameters if not p.fixed)
    return TorchCell(model, friction, every if sensitive is None else sensitive)
