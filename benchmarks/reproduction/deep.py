"""The conventional two-stage PINN with the real DeepXDE: a network of time, system parameters as external variables.

As in the DeepXDE examples of inverse problems: Adam, the equations as residuals at the samples, labels as point sets.
"""

from __future__ import annotations

import os
import time

import numpy as np

from reproduction.cases import Case
from reproduction.runs import Run

# Our choice where the paper says nothing: three layers of 40 tanh, Adam at 1e-3, and states and parameters in units of
# their own size, without which nothing trains.
LAYERS, RATE = [40, 40, 40], 1e-3


def fit(case: Case, seed: int, iterations: int) -> Run:
    """Train Model 1 for `iterations`; the result is their last.

    Raises:
        ImportError: DeepXDE is not installed.
    """
    os.environ.setdefault("DDE_BACKEND", "pytorch")
    import deepxde as dde
    import torch

    torch.set_default_dtype(torch.float32)
    dde.config.set_random_seed(seed)
    start, truth, t = case.start(seed), case.truth, case.recording.time
    scaled = {name: dde.Variable(1.0) for name in case.free}
    size = np.max(np.abs(case.states), axis=0)
    end, voltage = float(t[-1]), float(case.recording["voltage"][0])

    def equations(x: torch.Tensor, y: torch.Tensor) -> list[torch.Tensor]:
        p = {**truth, **{n: start[n] * v for n, v in scaled.items()}}
        i, w = size[0] * y[:, 0:1], size[1] * y[:, 1:2]
        di = size[0] / end * dde.grad.jacobian(y, x, i=0, j=0)
        dw = size[1] / end * dde.grad.jacobian(y, x, i=1, j=0)
        electrical = (voltage - p["R"] * i - p["k_b"] * w - p["L"] * di) / voltage
        torque = p["k_t"] * i - p["c_b"] * w - p["tau_fc"] * torch.sign(w) - p["J_r"] * dw
        return [electrical, torque / (truth["k_t"] * size[0])]

    points = (t / end)[:, None]
    domain = dde.geometry.TimeDomain(0.0, 1.0)
    labels = []
    for k, name in enumerate(case.model.state_names):
        if name in case.labels:
            labels.append(dde.icbc.PointSetBC(points, case.recording[name][:, None] / size[k], component=k))
        else:
            labels.append(dde.icbc.PointSetBC(points[:1], case.states[:1, k : k + 1] / size[k], component=k))
    data = dde.data.PDE(domain, equations, labels, num_domain=0, num_boundary=2, anchors=points)
    net = dde.nn.FNN([1, *LAYERS, 2], "tanh", "Glorot uniform")
    model = dde.Model(data, net)
    model.compile("adam", lr=RATE, external_trainable_variables=list(scaled.values()))
    begun = time.process_time()
    history, _ = model.train(iterations=iterations, display_every=max(1, iterations // 100), verbose=0)
    seconds = time.process_time() - begun
    values = {**truth, **{n: start[n] * float(v.detach()) for n, v in scaled.items()}}
    loss = tuple(float(np.sum(row)) for row in history.loss_train)
    return Run(values, seconds, f"{iterations} iterations", loss=loss)
