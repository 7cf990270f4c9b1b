"""Recursive least squares on the equations of motion, which are linear in the parameters.

    N tau = N J_m dw + N c_m w + N tau_fm sign(w) + c_1 e' + k_1 e + k_2 e^3           (motor)
    N tau = N J_m dw + N c_m w + N tau_fm sign(w) + J_q ddq + c_q dq + tau_fq sign(dq)  (motor and link)

All signals pass the same causal Butterworth filter (4th order, 50 Hz), then central differences of 7 points. The twist
e = theta_m / N - q is the integral of the motor velocity minus the link position, because a UR robot does not send the
motor position. What is old is forgotten with the time constant of the others. Sigma is that of white equation errors,
as textbooks have it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from peers.model2 import FREE
from scipy.signal import sosfilt

from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import STENCIL, FilterOptions
from online_methods.common import KEPT, PERIOD_S, START, Known, N, Signals

VAGUE = 1e6  # variance of the normalised parameters at the start, in units of that of the equation error
REACH = len(STENCIL) // 2


class RecursiveLeastSquares:
    """Parameters relative to their start values."""

    def __init__(self) -> None:
        self._scale = np.exp(START)
        self._x, self._P = np.ones(len(FREE)), VAGUE * np.eye(len(FREE))
        self._errors = np.array([0.0, 1e-9])  # sum of squares of equation errors, and their number
        self._sections = FilterOptions().sections(PERIOD_S)
        self._state: Array | None = None
        self._last = np.zeros((4, 0))  # filtered samples that later derivatives need
        self._angle = self._first = 0.0  # of the motor over N; of the link at the start
        self._before = np.zeros(2)  # motor velocity and torque of the last sample

    def update(self, samples: Signals) -> None:
        """Take new samples; those of the newest `2 REACH` instants wait for their derivatives."""
        if self._state is None:
            self._state = np.zeros((len(self._sections), 4, 2))
            self._angle = self._first = float(samples.q[0])
            self._before = np.array([samples.w[0], samples.torque[0]])
        # A torque is held from its sample to the next one: at a sample its mean over two periods acts.
        both = np.concatenate([self._before[:, None], [samples.w, samples.torque]], axis=1)
        w, torque = 0.5 * (both[:, 1:] + both[:, :-1])
        angle = self._angle + PERIOD_S / N * np.cumsum(w)
        self._angle, self._before = float(angle[-1]), both[:, -1]
        raw = np.stack([samples.q - self._first, samples.w, torque, angle - samples.q])  # all begin near zero
        smooth, self._state = sosfilt(self._sections, raw, axis=1, zi=self._state)
        smooth = np.concatenate([self._last, smooth], axis=1)
        self._last = smooth[:, -4 * REACH :]
        if smooth.shape[1] <= 4 * REACH:
            return
        rate = np.array([np.convolve(row, STENCIL[::-1], "valid") for row in smooth[[0, 1, 3]]]) / PERIOD_S
        curvature = np.convolve(rate[0], STENCIL[::-1], "valid") / PERIOD_S
        _, w, torque, e = smooth[:, 2 * REACH : -2 * REACH]
        dq, dw, de = rate[:, REACH:-REACH]
        motor = np.array([N * dw, N * w, N * np.sign(w)])
        zero = np.zeros((3, len(w)))
        gear, link = np.array([de, e, e**3]), np.array([curvature, dq, np.sign(dq)])
        rows = np.stack([np.concatenate([motor, gear, zero]), np.concatenate([motor, zero, link])])
        _take(self._x, self._P, self._errors, rows * self._scale[:, None], N * torque, KEPT)

    def known(self) -> Known:
        """What is known now."""
        sigma = np.sqrt(self._errors[0] / self._errors[1] * np.maximum(np.diag(self._P), 0.0))
        values, sigmas = self._x * self._scale, sigma * self._scale
        return Known(dict(zip(FREE, values.tolist(), strict=True)), dict(zip(FREE, sigmas.tolist(), strict=True)))


@njit(cache=True)
def _take(x: Array, P: Array, errors: Array, rows: Array, right: Array, kept: float) -> None:
    """Update estimate `x` (9,), `P` (9, 9) and the errors with rows (2, 9, T) and right sides (T,)."""
    for t in range(rows.shape[2]):
        P /= kept
        errors *= kept
        for i in range(2):
            h = np.ascontiguousarray(rows[i, :, t])
            Ph = P @ h
            s = 1.0 + h @ Ph
            miss = right[t] - h @ x
            x += Ph * (miss / s)
            P -= np.outer(Ph, Ph) / s
            errors[0] += miss * miss / s
            errors[1] += 1.0
