"""Extended Kalman filter whose state is that of the joint and the logarithms of the nine parameters.

Its step is the compiled cell of the library with smoothed friction; derivatives are central differences. It is told the
noise levels. What is known of the parameters is forgotten with the time constant of the others.
"""

from __future__ import annotations

import numpy as np
from online.joints import TORQUE_NOISE
from peers.model2 import FREE, MODEL, SMOOTHING, SUBSTEPS

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array
from online_methods.common import (
    KEPT,
    PERIOD_S,
    SIGMA_Q,
    SIGMA_W,
    SPREAD,
    START,
    Known,
    Signals,
    first_state,
    of_logarithms,
)

SIZE = np.array([1e-4, 1e-6, 1e-3, 1e-5, *[1e-5] * len(FREE)])  # of the differences
LABELS = ((1, SIGMA_Q**2), (2, SIGMA_W**2))  # index of the state, variance


class ExtendedKalmanFilter:
    """State and parameters, sample by sample."""

    def __init__(self) -> None:
        self._kernel = compile_model(MODEL, "tanh")
        values = MODEL.values(SMOOTHING)
        self._p = np.array([values[name] for name in MODEL.parameter_names])
        self._index = [MODEL.parameter_names.index(name) for name in FREE]
        self._n = len(MODEL.states)
        self._z: Array | None = None
        self._P = np.zeros((0, 0))
        self._time, self._X = np.array([0.0, PERIOD_S]), np.empty((2, self._n))
        self._u = np.zeros((2, len(MODEL.inputs)))
        fade = np.concatenate([np.ones(self._n), np.full(len(FREE), KEPT**-0.5)])
        self._fade = np.outer(fade, fade)

    def update(self, samples: Signals) -> None:
        """Take new samples."""
        if self._z is None:
            x, P = first_state(float(samples.q[0]))
            self._z = np.concatenate([x, START])
            self._P = np.diag(np.concatenate([np.diag(P), np.full(len(FREE), SPREAD**2)]))
        z, P = self._z, self._P
        for y, torque in zip(zip(samples.q, samples.w, strict=True), samples.torque, strict=True):
            for (i, variance), label in zip(LABELS, y, strict=True):
                gain = P[:, i] / (P[i, i] + variance)
                z = z + gain * (label - z[i])
                P = P - np.outer(gain, P[i])
            F = np.array([self._ahead(z + d, torque) - self._ahead(z - d, torque) for d in np.diag(SIZE)]).T
            F /= 2.0 * SIZE
            G = (self._ahead(z, torque + TORQUE_NOISE) - self._ahead(z, torque - TORQUE_NOISE)) / 2.0
            z, P = self._ahead(z, torque), (F @ P @ F.T + np.outer(G, G)) * self._fade
            P = 0.5 * (P + P.T)
        self._z, self._P = z, P

    def _ahead(self, z: Array, torque: float) -> Array:
        """State and parameters one sample later."""
        n = self._n
        self._p[self._index] = np.exp(z[n:])
        self._u[:, 0] = torque
        self._kernel.module.rollout(z[None, :n].copy(), 2, self._time, self._u, self._p, SUBSTEPS_OF_TWO, self._X)
        return np.concatenate([self._X[1], z[n:]])

    def known(self) -> Known:
        """What is known now."""
        assert self._z is not None
        return of_logarithms(self._z[self._n :], self._P[self._n :, self._n :])


SUBSTEPS_OF_TWO = np.full(2, SUBSTEPS, dtype=np.int64)
