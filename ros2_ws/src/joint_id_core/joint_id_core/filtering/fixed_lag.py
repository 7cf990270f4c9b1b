"""The core of the streaming filter: state of the forward filter, buffer of fixed lag, and weights over this buffer."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np
import scipy  # whose parts load when used: scipy.signal takes half a second
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import REACH, STENCIL, FilterOptions, settling


class FilterDesign:
    """Coefficients for given options and period: the forward filter, and the weights over the fixed lag.

    Attributes:
        forward: [output; next state] = forward @ [input; state], shape (1 + n, 1 + n).
        steady: steady state for a constant input 1, shape (n,).
        weights: weights of the forward filter's outputs for value, first and second derivative, shape (3, W).
        ahead: number of later samples that a result needs.
        memory: number of earlier samples that a result depends on.
        delay: group delay in s that must still be subtracted from the time (0 unless `causal`).
    """

    def __init__(self, options: FilterOptions, period: float) -> None:
        sos = options.sections(period)
        self.period = period
        n = 2 * len(sos)
        self.forward = np.empty((1 + n, 1 + n))
        for k, unit in enumerate(np.eye(1 + n)):  # one step of scipy's own filter from each unit state
            y, state = scipy.signal.sosfilt(sos, unit[:1], zi=unit[1:].reshape(-1, 2))
            self.forward[:, k] = np.concatenate([y, state.ravel()])
        self.steady = scipy.signal.sosfilt_zi(sos).ravel()
        length = settling(sos)
        backward = np.ones(1) if options.causal else scipy.signal.sosfilt(sos, np.eye(1, length)[0])
        backward /= backward.sum()
        value = np.eye(1, 4 * REACH + 1, 2 * REACH)[0]
        stencils = (value, np.pad(STENCIL, REACH) / period, np.convolve(STENCIL, STENCIL) / period**2)
        self.weights = np.array([np.convolve(stencil, backward) for stencil in stencils])
        self.ahead = len(backward) - 1 + 2 * REACH
        self.memory = length + 2 * REACH
        self.delay = options.delay(period) if options.causal else 0.0


class Run:
    """The filter between two restarts, on an evenly spaced grid that starts at its first sample."""

    def __init__(
        self,
        design: FilterDesign,
        inputs: tuple[str, ...],
        wanted: Mapping[str, tuple[str, ...]],
        start: float,
        columns: int,
    ) -> None:
        self.design, self.inputs, self.wanted, self.start = design, inputs, wanted, start
        self.derived = frozenset(name for names in wanted.values() for name in names)
        self.bad = np.zeros(columns, dtype=bool)
        self._times: deque[float] = deque(maxlen=4)
        self._rows = np.zeros((4, columns))
        self._bad_rows = np.zeros((4, columns), dtype=bool)
        self._width = design.weights.shape[1]
        self._buffer = np.zeros((2 * self._width, columns))  # each output twice, so that the latest are contiguous
        self._io = np.zeros((len(design.forward), columns))
        self._outputs = np.full((4, 3 * columns), np.nan)
        self._spoilt = np.zeros(columns, dtype=np.int64)  # grid index of the last unusable input, at first the start
        self._next = 0  # grid index of the next input

    def take(self, time: float, row: Array, bad: NDArray[np.bool_]) -> None:
        """Add a sample; a value that is not finite is replaced by the previous one."""
        self._rows[:3], self._bad_rows[:3] = self._rows[1:], self._bad_rows[1:]
        self._rows[3] = np.where(bad, self._rows[2], row) if bad.any() else row
        self._bad_rows[3] = self.bad = bad
        self._times.append(time)

    def step(self) -> bool:
        """Advance by one grid point; return False if more samples are needed first."""
        at = self.start + self._next * self.design.period
        if len(self._times) < 4 or at >= self._times[2]:
            return False
        x = _weights(at, self._times) @ self._rows
        if self._bad_rows.any():
            self._spoilt[self._bad_rows.any(axis=0)] = self._next
        if self._next == 0:
            self._io[1:] = np.outer(self.design.steady, x)
            self._buffer[:] = x
        self._io[0] = x
        self._io = self.design.forward @ self._io
        k = self._next % self._width
        self._buffer[k] = self._buffer[k + self._width] = self._io[0]
        result = self.design.weights @ self._buffer[k + 1 : k + 1 + self._width]
        result[:, self._next - self._spoilt <= self.design.ahead + self.design.memory] = np.nan
        self._outputs[:3] = self._outputs[1:]
        self._outputs[3] = result.ravel()
        self._next += 1
        return True

    def ready(self, time: float) -> bool:
        """Return whether the outputs reach two grid points beyond an instant."""
        return self._first(time) + 3 <= self._next - 1 - self.design.ahead

    def at(self, time: float) -> Array:
        """Return value, first and second derivative at an instant that has just become ready, shape (3, columns)."""
        nodes = [self.start + (self._next - 4 - self.design.ahead + k) * self.design.period for k in range(4)]
        return (_weights(time, nodes) @ self._outputs).reshape(3, -1)

    def _first(self, time: float) -> int:
        return max(int((time - self.start) / self.design.period) - 1, 0)


def _weights(at: float, nodes: deque[float] | list[float]) -> Array:
    """Return the interpolation weights of the cubic through four nodes, shape (4,)."""
    a, b, c, d = nodes
    pa, pb, pc, pd = at - a, at - b, at - c, at - d
    return np.array(
        [
            pb * pc * pd / ((a - b) * (a - c) * (a - d)),
            pa * pc * pd / ((b - a) * (b - c) * (b - d)),
            pa * pb * pd / ((c - a) * (c - b) * (c - d)),
            pa * pb * pc / ((d - a) * (d - b) * (d - c)),
        ]
    )
