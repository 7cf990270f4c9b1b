"""Simulation of a record with the compiled cell (RK4 or implicit), with or without exact sensitivities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

Steps = NDArray[np.int64]


def _arrays(
    kernel: Kernel, x0: Array, time: Array, u: Array, p: Array, substeps: int | Steps
) -> tuple[Array, Array, Array, Array, Steps]:
    model = kernel.model
    shapes = {"x0": (len(model.states),), "u": (len(time), len(model.inputs)), "p": (len(model.parameters),)}
    arrays = {"x0": x0, "u": u, "p": p}
    for name, shape in shapes.items():
        arrays[name] = np.ascontiguousarray(arrays[name], dtype=float)
        if arrays[name].shape != shape:
            raise JointIdError(f"{name} for model {model.name} must have shape {shape}, not {arrays[name].shape}")
    steps = np.full(len(time), substeps, dtype=np.int64)
    if steps.min(initial=1) < 1:
        raise JointIdError(f"substeps = {steps.min()}: must be at least 1")
    return arrays["x0"], np.ascontiguousarray(time, dtype=float), arrays["u"], arrays["p"], steps


def rollout(kernel: Kernel, x0: Array, time: Array, u: Array, p: Array, substeps: int | Steps = 1) -> Array:
    """Simulate a model with `substeps` integrator steps per sample.

    Args:
        kernel: from `cell.kernel.compile_model`.
        x0: start state, shape (n,).
        time: instants in s, shape (T,).
        u: inputs at these instants, shape (T, inputs).
        p: values of all parameters in the model's order, shape (parameters,).
        substeps: integrator steps from each sample to the next, one number or shape (T,).

    Returns:
        States, shape (T, n).
    """
    return restarted(kernel, np.asarray(x0)[None], max(1, len(time)), time, u, p, substeps)


def restarted(
    kernel: Kernel, starts: Array, block: int, time: Array, u: Array, p: Array, substeps: int | Steps = 1
) -> Array:
    """Simulate as `rollout`, but restart every `block` samples from the next row of `starts`, shape (B, n).

    At a sample where the simulation restarts, the returned state is the last one of the previous run.
    """
    x0, time, u, p, steps = _arrays(kernel, starts[0], time, u, p, substeps)
    X = np.empty((len(time), len(x0)))
    kernel.module.rollout(np.ascontiguousarray(starts, dtype=float), block, time, u, p, steps, X)
    return X


def rollout_sensitivities(
    kernel: Kernel, x0: Array, time: Array, u: Array, p: Array, substeps: int = 1
) -> tuple[Array, Array]:
    """Simulate with the exact derivatives of the discrete recursion (forward sensitivities).

    Returns:
        X (T, n), dX/dp (T, n, len(kernel.sensitive)).
    """
    x0, time, u, p, steps = _arrays(kernel, x0, time, u, p, substeps)
    T, n = len(time), len(x0)
    X, J = np.empty((T, n)), np.empty((T, n, len(kernel.sensitive)))
    kernel.sensitivities.rollout_sensitivities(x0, time, u, p, steps, X, J)
    return X, J
