"""H-PINN as the paper describes it, through the compiled cell; and what an epoch of it takes in eager torch."""

from __future__ import annotations

import time

import numpy as np

from joint_id_core.estimators.start import start_state
from joint_id_core.hpinn import HPinn, label_weights, torch, wmse
from joint_id_core.problem import prepare
from joint_id_core.training import LearningRate, make_labels, train
from reproduction.cases import FACTOR, Case
from reproduction.runs import Run

# The paper prints a piecewise decay and no rates. Of the rates tried these end nearest to the truth.
RATES = LearningRate(0.02, (0.4, 0.6, 0.8), 0.3)


def fit(case: Case, seed: int, epochs: int, substeps: int = 1, factor: float = FACTOR) -> Run:
    """Train for `epochs` with sign friction, from starts off by `factor`; the result is the epoch of lowest loss."""
    start = {**case.truth, **case.start(seed, factor)}
    problem = prepare(case.model, case.measured, start, freed=case.freed)
    labels = make_labels(problem, case.torsion)
    net = HPinn(case.model, start, problem.free, case.bounds, "sign", substeps)
    x0 = start_state(problem)[0]
    with torch.no_grad():
        net(torch.from_numpy(x0), problem.time[:3], problem.u[:3])  # compiles
    begun = time.process_time()
    loss, finite = train(net, problem, labels, x0, epochs, RATES)
    seconds = time.process_time() - begun
    return Run(net.values, seconds, "trained" if finite else f"not finite at epoch {len(loss)}", loss=tuple(loss))


def eager_epoch_s(case: Case, seed: int, substeps: int = 1, epochs: int = 1) -> float:
    """Seconds of an epoch, forward and backward, of the network unrolled in torch, without the compiled cell."""
    start = {**case.truth, **case.start(seed)}
    problem = prepare(case.model, case.measured, start, freed=case.freed)
    labels = make_labels(problem, case.torsion)
    net = HPinn(case.model, start, problem.free, case.bounds, "sign", substeps, compiled=False)
    weights, y, mix = (torch.from_numpy(np.asarray(a)) for a in (label_weights(labels.y), labels.y, labels.mix))
    x0, begun = torch.from_numpy(start_state(problem)[0]), time.process_time()
    for _ in range(epochs):
        loss = wmse(net(x0, problem.time, problem.u)[:, labels.states] @ mix.T, y, weights)
        torch.autograd.grad(loss, [net.weight])
    return (time.process_time() - begun) / epochs
