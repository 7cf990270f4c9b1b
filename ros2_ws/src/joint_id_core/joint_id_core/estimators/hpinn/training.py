"""Training of the H-PINN: labels, and RMSProp with piecewise learning-rate decay (paper section III)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.hpinn.network import HPinnNetwork, label_weights, torch, wmse
from joint_id_core.estimators.shared.fit_data import FitData

TELL_S = 0.5  # time between two reports of the progress
TORSION = "torsion"  # the paper's extra label dtheta = theta_m / N - q


@dataclass(frozen=True)
class LearningRate:
    """Learning rate: `start`, multiplied by `decay_factor` at each of the fractions `decay_at` of the epochs."""

    start: float
    decay_at: tuple[float, ...]
    decay_factor: float

    def rmsprop(
        self, weight: torch.nn.Parameter, epochs: int
    ) -> tuple[torch.optim.Optimizer, torch.optim.lr_scheduler.LRScheduler]:
        """Return the optimizer of a training with its schedule."""
        # The paper used the Keras defaults of RMSprop: forgetting factor and epsilon differ from torch's.
        optimizer = torch.optim.RMSprop([weight], lr=self.start, alpha=0.9, eps=1e-7)
        milestones = [round(share * epochs) for share in self.decay_at]
        return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, milestones, self.decay_factor)


@dataclass(frozen=True)
class Labels:
    """Labels of the loss, and how to compute them from states.

    Attributes:
        names: of the labels.
        y: measured labels, shape (T, m), NaN where not measured.
        mix: matrix from measured states to labels, shape (m, measured states): the identity, and a row for the torsion.
        states: index of each measured state among the model's states.
    """

    names: tuple[str, ...]
    y: Array
    mix: Array
    states: np.ndarray


def make_labels(data: FitData, torsion: bool) -> Labels:
    """Build the labels of a record; `torsion` adds the torsion if both angles are measured.

    The torsion uses the start value of N. A label that is always zero is left out: Eq 2 gives it no finite weight.
    """
    # The labels come from the recording and not from data.y, which leaves out zeros that repeat exactly. This loss
    # estimates no noise, so such values do no harm, and the steady state of a step response consists of them.
    every = np.column_stack([data.recording[name] for name in data.labels])
    used = [k for k in range(len(data.labels)) if np.any(np.nan_to_num(every[:, k]) != 0.0)]
    names = tuple(data.labels[k] for k in used)
    mix, y = np.eye(len(names)), every[:, used]
    if torsion and {"motor_position", "link_position"} <= set(names):
        motor, link = names.index("motor_position"), names.index("link_position")
        ratio = data.model.gear_ratio(dict(zip(data.model.parameter_names, data.p.tolist(), strict=True)))
        y = np.column_stack([y, y[:, motor] / ratio - y[:, link]])
        mix, names = np.vstack([mix, mix[motor] / ratio - mix[link]]), (*names, TORSION)
    return Labels(names, y, mix, data.label_states[used])


def train(
    net: HPinnNetwork,
    data: FitData,
    labels: Labels,
    x0: Array,
    epochs: int,
    rates: LearningRate,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[list[float], bool]:
    """Train with RMSProp and a piecewise constant learning rate (paper section III), with bounds after every step.

    Leaves the weights of the best epoch in `net`. Returns the loss of each epoch and whether all were finite.
    """
    optimizer, schedule = rates.rmsprop(net.weight, epochs)
    weights, y = torch.from_numpy(label_weights(labels.y)), torch.from_numpy(labels.y)
    mix, start, history = torch.from_numpy(labels.mix), torch.from_numpy(x0), list[float]()
    best, finite = net.weight.detach().clone(), True
    begun = told = time.monotonic()
    for epoch in range(epochs):
        loss = wmse(net(start, data.time, data.u)[:, labels.states] @ mix.T, y, weights)
        (net.weight.grad,) = torch.autograd.grad(loss, [net.weight])
        finite = bool(torch.isfinite(loss) & torch.isfinite(net.weight.grad).all())
        if not finite:
            break
        if loss.item() < min(history, default=np.inf):
            best = net.weight.detach().clone()
        history.append(loss.item())
        now = time.monotonic()
        if now - told > TELL_S:
            told, left = now, (now - begun) / (epoch + 1) * (epochs - epoch - 1)
            tell(f"epoch {epoch + 1} of {epochs}, loss {history[-1]:.3g}, about {left:.0f} s left")
        optimizer.step()
        schedule.step()
        net.project()
    with torch.no_grad():
        net.weight.copy_(best)
    return history, finite
