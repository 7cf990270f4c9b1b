"""The paper's way: an unrolled recurrent net of RK4 cells in eager torch, weighted mean square error, RMSProp.

As in the paper one RK4 step a sample, Coulomb friction with sign, 300 epochs over the whole record, and a learning rate
that falls in steps. Labels are weighted by their noise instead of their size, for these the better weights; with them
the paper's extra label, the torsion, would add nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from joint_id_core.estimators.hpinn.network import RK4Cell, wmse
from peers.model2 import FREE, MODEL, Data, Fit, parameters, processor_s, unknowns, values

EPOCHS = 300
# A first step of 3 % an epoch: a factor of three away, the truth is 37 epochs off. The paper prints no rate.
RATE, DECAY_AT, DECAY = 0.03, (0.4, 0.6, 0.8), 0.3

torch.set_num_threads(1)


def fit(data: Data, start: Mapping[str, float], limit_s: float) -> Fit:
    """Fit from `start`, for at most `limit_s` of processor time; the result is the epoch of lowest loss."""
    begun = processor_s()
    cell = RK4Cell(MODEL, "sign", 1)
    z = torch.nn.Parameter(torch.from_numpy(unknowns(start)))
    u, y, sigma = (torch.from_numpy(a) for a in (data.u, data.y, data.sigma))
    steps = np.diff(data.recording.time).tolist()
    # Keras defaults of RMSprop, which the paper used: forgetting factor and epsilon differ from torch's.
    optimizer = torch.optim.RMSprop([z], lr=RATE, alpha=0.9, eps=1e-7)
    schedule = torch.optim.lr_scheduler.MultiStepLR(optimizer, [round(share * EPOCHS) for share in DECAY_AT], DECAY)
    best, lowest, epoch = z.detach().clone(), np.inf, 0
    while epoch < EPOCHS and processor_s() - begun < limit_s:
        p = parameters(torch.exp(z[: len(FREE)]).unbind())
        x = [y[0] + sigma * z[len(FREE) :]]
        for k, dt in enumerate(steps):
            x.append(cell(x[-1], u[k], u[k + 1], dt, p))
        loss = wmse(torch.stack(x), y, 1.0 / sigma)
        (z.grad,) = torch.autograd.grad(loss, [z])
        if not bool(torch.isfinite(loss) & torch.isfinite(z.grad).all()):
            break
        if loss.item() < lowest:
            best, lowest = z.detach().clone(), loss.item()
        optimizer.step()
        schedule.step()
        epoch += 1
    return Fit(values(best.numpy()), processor_s() - begun, 0.0, epoch, epoch == EPOCHS)
