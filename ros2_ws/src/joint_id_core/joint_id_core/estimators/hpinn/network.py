"""The paper's H-PINN: a recurrent network whose cell is one Runge-Kutta step of the joint model.

Yang, Du, Li, Zhou, Zhang, "Physics-Informed Neural Network for Model Prediction and Dynamics Parameter
Identification of Collaborative Robot Joints", section III. The trainable weights are the physical parameters.
`RK4Cell` is the network in plain torch. `HPinnNetwork` unrolls it, by default with the compiled kernel: its exact
forward sensitivities give the same gradient some thousand times faster than autograd through a loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from joint_id_core.cell.kernel import Kernel, compile_model
from joint_id_core.cell.rollout import rollout_sensitivities
from joint_id_core.cell.symbolic import Smoothing
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.tensors.torch_cell import torch, torch_cell

POSITIVE_FLOOR = 1e-3  # lower bound of a positive parameter over its start value: models divide by an inertia


class RK4Cell(torch.nn.Module):
    """One sample step of the classic fourth-order Runge-Kutta method on `model.derivative` (paper Eq 1).

    Args:
        model: the joint model.
        friction: "sign" as in the paper, or "tanh".
        substeps: RK4 steps per sample.
    """

    def __init__(self, model: Model, friction: Smoothing = "sign", substeps: int = 1) -> None:
        super().__init__()
        self.model, self.substeps = model, substeps
        self.cell = torch_cell(model, friction)

    def forward(
        self, x: torch.Tensor, u: torch.Tensor, u_next: torch.Tensor, dt: float, p: SimpleNamespace
    ) -> torch.Tensor:
        """Return the state one sample later.

        Args:
            x: state, shape (n,), SI units.
            u, u_next: inputs at this sample and at the next, shape (nu,). Between them an input is constant (hold
                "zero") or runs on to the next value (hold "first"), bent by its rate (`Model.rates`).
            dt: time to the next sample in s.
            p: parameters by attribute.
        """
        c = self.cell.constants([getattr(p, name) for name in self.model.parameter_names])
        return torch.stack(self.cell.step(x.unbind(), u.unbind(), u_next.unbind(), c, dt, self.substeps))


class _CompiledRollout(torch.autograd.Function):
    """The unrolled cell as one node of the autograd graph: sensitivities forward, vector-Jacobian product backward."""

    @staticmethod
    def forward(
        ctx: Any, x0: torch.Tensor, p: torch.Tensor, kernel: Kernel, time: Array, u: Array, substeps: int
    ) -> Any:
        x, s_p = rollout_sensitivities(kernel, x0.detach().numpy(), time, u, p.detach().numpy(), substeps)
        ctx.save_for_backward(torch.from_numpy(s_p))
        ctx.columns = [kernel.parameter_names.index(name) for name in kernel.sensitive]
        ctx.size = len(p)
        return torch.from_numpy(x)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: torch.Tensor) -> Any:
        (grad,) = grad_outputs
        (s_p,) = ctx.saved_tensors
        grad_p = torch.zeros(ctx.size, dtype=torch.float64)
        grad_p[ctx.columns] = torch.einsum("tn,tnk->k", grad, s_p)
        return None, grad_p, None, None, None, None


class HPinnNetwork(torch.nn.Module):
    """The recurrent network: it predicts states from inputs and a start state (paper Fig. 2a).

    Each weight is a parameter divided by a scale. The scale is the start value; for a parameter that may be negative it
    is the larger of the start value and `spread`. So one learning rate serves inertias of 1e-5 and stiffnesses of 1e8.
    The paper does not say how it does this: the scaling is our choice.

    Args:
        model: the joint model.
        values: start values of all parameters, SI units.
        trainable: names of the parameters to train; the others stay fixed.
        bounds: interval by parameter, narrower than the model's own.
        friction: "sign" as in the paper, or "tanh".
        substeps: RK4 steps per sample.
        compiled: True simulates with the compiled kernel; False unrolls `RK4Cell` in torch.

    Raises:
        JointIdError: a positive parameter that is to be trained starts at zero, or a start value is out of bounds.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        trainable: Sequence[str],
        bounds: Mapping[str, tuple[float, float]] | None = None,
        friction: Smoothing = "sign",
        substeps: int = 1,
        compiled: bool = True,
    ) -> None:
        super().__init__()
        self.model, self.trainable, self.substeps = model, tuple(trainable), substeps
        self.cell = None if compiled else RK4Cell(model, friction, substeps)
        freed = tuple(sorted(name for name in self.trainable if model.parameter(name).fixed))
        self.kernel = compile_model(model, friction, freed) if compiled else None
        start = np.array([values[name] for name in self.trainable])
        self.scale = np.array([scale_of(model, name, values[name]) for name in self.trainable])
        intervals = [interval_of(model, name, values[name], bounds or {}) for name in self.trainable]
        self.lower, self.upper = np.array(intervals).reshape(-1, 2).T
        self.weight = torch.nn.Parameter(torch.tensor(start / self.scale, dtype=torch.float64))
        self._fixed = torch.tensor([values[name] for name in model.parameter_names], dtype=torch.float64)
        self._index = torch.tensor([model.parameter_names.index(name) for name in self.trainable], dtype=torch.long)

    @property
    def parameters_si(self) -> torch.Tensor:
        """All parameters in the model's order, in SI units, shape (P,)."""
        return self._fixed.index_put((self._index,), self.weight * torch.from_numpy(self.scale))

    @property
    def values(self) -> dict[str, float]:
        """Present value of every parameter by name, SI units."""
        return dict(zip(self.model.parameter_names, self.parameters_si.tolist(), strict=True))

    def forward(self, x0: torch.Tensor, time: Array, u: Array) -> torch.Tensor:
        """Return the predicted states, shape (T, n).

        Args:
            x0: start state, shape (n,), SI units.
            time: instants in s, shape (T,).
            u: inputs at these instants, shape (T, nu), SI units.

        Raises:
            JointIdError: x0 requires a gradient, which the compiled cell does not have.
        """
        p = self.parameters_si
        if self.kernel is not None:
            if x0.requires_grad:
                raise JointIdError(
                    "the compiled cell has no gradient by the start state: build HPinnNetwork with compiled=False"
                )
            return _CompiledRollout.apply(x0, p, self.kernel, time, u, self.substeps)
        assert self.cell is not None
        by_name = SimpleNamespace(**dict(zip(self.model.parameter_names, p.unbind(), strict=True)))
        inputs, steps, states = torch.from_numpy(u), np.diff(time), [x0]
        for k, dt in enumerate(steps):
            states.append(self.cell(states[-1], inputs[k], inputs[k + 1], float(dt), by_name))
        return torch.stack(states)

    def sensitivities(self, x0: Array, time: Array, u: Array) -> tuple[Array, Array]:
        """Return states (T, n) and their exact derivatives by the trainable parameters (T, n, k), SI units."""
        assert self.kernel is not None, "the eager cell has no forward sensitivities"
        columns = [self.kernel.sensitive.index(name) for name in self.trainable]
        x, s_p = rollout_sensitivities(self.kernel, x0, time, u, self.parameters_si.detach().numpy(), self.substeps)
        return x, s_p[:, :, columns]

    @torch.no_grad()
    def project(self) -> None:
        """Clip every weight to its interval, as a Keras constraint does after each step."""
        self.weight.copy_(torch.clamp(
            self.weight, torch.from_numpy(self.lower / self.scale), torch.from_numpy(self.upper / self.scale)
        ))  # fmt: skip

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that lie on a bound."""
        value, slack = self.weight.detach().numpy() * self.scale, 1e-9 * self.scale
        held = (value <= self.lower + slack) | (value >= self.upper - slack)
        return tuple(name for name, on in zip(self.trainable, held, strict=True) if on)


def scale_of(model: Model, name: str, start: float) -> float:
    """Return what a weight is multiplied by to get the parameter: see `HPinnNetwork`."""
    p = model.parameter(name)
    if p.positive and not start > 0:
        raise JointIdError(
            f"parameter {name} starts at {start:g} {p.unit} but must be positive to be trained: "
            "give a start value above zero (--set) or fix it"
        )
    return start if p.positive else max(abs(start), p.spread)


def interval_of(
    model: Model, name: str, start: float, bounds: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """Return the interval (lower, upper) that training keeps a parameter in."""
    p = model.parameter(name)
    lower, upper = bounds.get(name, (-np.inf, np.inf))
    lower, upper = max(lower, p.lower, POSITIVE_FLOOR * start if p.positive else -np.inf), min(upper, p.upper)
    if not lower <= start <= upper:
        raise JointIdError(
            f"parameter {name} starts at {start:g} {p.unit}, outside [{lower:g}, {upper:g}]: "
            "move its start value (--set) or its bounds"
        )
    return lower, upper


def label_weights(labels: Array) -> Array:
    """Return w_i = |y_max / y_i,max| (paper Eq 2), shape (m,), from labels of shape (T, m), NaN where not measured.

    Maxima are of the absolute values, so that a motion in the negative direction has the same weight.
    """
    peak = np.nanmax(np.abs(labels), axis=0)
    return np.asarray(peak.max() / peak)


def wmse(predicted: torch.Tensor, labels: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """Return the weighted mean square error (paper Eq 3): mean over the samples of each label, then over the labels.

    Args:
        predicted, labels: shape (T, m); NaN labels are skipped one by one.
        weights: of the labels, shape (m,).
    """
    known = ~torch.isnan(labels)
    # NaN labels are replaced by zeros before the subtraction: NaN * 0 would make the gradient NaN
    error = torch.where(
        known, predicted - torch.where(known, labels, torch.zeros_like(labels)), torch.zeros_like(labels)
    )
    return ((weights * error) ** 2).sum(0).div(known.sum(0)).mean()
