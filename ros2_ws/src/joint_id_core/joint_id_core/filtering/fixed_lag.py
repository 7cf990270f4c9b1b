"""The core of the streaming filter: state of the forward filter, buffer of fixed lag, and weights over this buffer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import scipy  # whose parts load when used: scipy.signal takes half a second
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import REACH, STENCIL, FilterOptions, settling

CUT = 1e-3  # share of the backward filter's impulse response that is left out, to keep the lag short
_FOUR = np.arange(4)


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

    def __init__(self, options: FilterOptions, period: float, cut: float = CUT) -> None:
        sos = options.sections(period)
        self.period = period
        n = 2 * len(sos)
        self.forward = np.empty((1 + n, 1 + n))
        for k, unit in enumerate(np.eye(1 + n)):  # one step of scipy's own filter from each unit state
            y, state = scipy.signal.sosfilt(sos, unit[:1], zi=unit[1:].reshape(-1, 2))
            self.forward[:, k] = np.concatenate([y, state.ravel()])
        self.steady = scipy.signal.sosfilt_zi(sos).ravel()
        length = settling(sos)
        backward = np.ones(1)
        if not options.causal:
            backward = _shortened(scipy.signal.sosfilt(sos, np.eye(1, length)[0]), settling(sos, cut))
        value = np.eye(1, 4 * REACH + 1, 2 * REACH)[0]
        stencils = (value, np.pad(STENCIL, REACH) / period, np.convolve(STENCIL, STENCIL) / period**2)
        self.weights = np.array([np.convolve(stencil, backward) for stencil in stencils])
        self.ahead = len(backward) - 1 + 2 * REACH
        self.memory = length + 2 * REACH
        self.delay = options.delay(period) if options.causal else 0.0


def _shortened(response: Array, length: int) -> Array:
    """Return the first `length` values of an impulse response, changed such that slow signals do not feel the cut.

    The change is the smallest in the mean square for which the gain at frequency zero is 1, and delay and curvature
    there (the moments of the response of order 1 and 2) are those of the whole response.
    """
    response = response / response.sum()
    moments = np.vander(np.arange(len(response)) / len(response), 3, increasing=True).T
    missing = moments[:, length:] @ response[length:]
    return response[:length] + np.linalg.lstsq(moments[:, :length], missing, rcond=None)[0]


class Run:
    """The filter between two restarts, on an evenly spaced grid that starts at its first sample.

    Samples come in batches; results do not depend on how the samples are split into batches.
    """

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
        self.bad = np.zeros(columns, dtype=bool)  # whether the newest value was unusable
        # The newest samples, up to three: the nodes of the next interpolation begin among them.
        self._times: list[float] = []
        self._rows = np.zeros((0, columns))
        self._bad_rows = np.zeros((0, columns), dtype=bool)
        self._io = np.zeros((len(design.forward), columns))
        self._smooth = np.zeros((0, columns))  # newest outputs of the forward filter, as many as the weights need
        self._outputs = np.full((3, 3, columns), np.nan)  # value, first and second derivative at the newest grid points
        self._spoilt = np.zeros(columns, dtype=np.int64)  # grid index of the last unusable input, at first the start
        self._next = 0  # grid index of the next input

    def take(self, times: list[float], rows: Array, bad: NDArray[np.bool_]) -> None:
        """Add samples, shapes (T,), (T, columns), and advance; a value that is not finite is replaced by the previous.

        Call `results` with the instants that wait before the next samples are taken.
        """
        self.bad = bad[-1]
        if bad.any():
            rows, last = rows.copy(), self._rows[-1] if len(self._rows) else np.zeros(rows.shape[1])
            for row, unusable in zip(rows, bad, strict=True):
                row[unusable] = last[unusable]
                last = row
        times, rows = self._times + times, np.concatenate([self._rows, rows])
        bad = np.concatenate([self._bad_rows, bad])
        if len(times) >= 4:
            self._advance(times, rows, bad)
        self._times, self._rows, self._bad_rows = times[-3:], rows[-3:], bad[-3:]

    def _advance(self, times: list[float], rows: Array, bad: NDArray[np.bool_]) -> None:
        """Filter up to the last grid point that has two samples behind it."""
        # Plain numbers: batches of a live stream are so short that a call of NumPy costs more than a few turns.
        begin, k = self._next, 2
        weights: list[tuple[float, ...]] = []
        first: list[int] = []
        while (at := self.start + (begin + len(first)) * self.design.period) < times[-2]:
            while times[k] <= at:
                k += 1
            weights.append(_weights(at, *times[k - 2 : k + 2]))
            first.append(k - 2)
        if not first:
            return
        nodes = np.array(first)[:, None] + _FOUR
        inputs = (np.array(weights)[:, None] @ rows[nodes])[:, 0]
        self._outputs = np.concatenate([self._outputs[-3:], self._differentiated(inputs)])
        self._next += len(first)
        if bad.any() or self._spoilt.max(initial=-1) >= begin - self.design.ahead - self.design.memory:
            self._mark(begin, np.any(bad[nodes], axis=1))

    def _mark(self, begin: int, bad: Any) -> None:
        """Set the newest outputs to NaN where an unusable input, or the start, could still be seen."""
        indices = np.arange(begin, self._next)[:, None]
        spoilt = np.maximum.accumulate(np.where(bad, indices, self._spoilt))
        self._spoilt = spoilt[-1]
        unsettled = indices - spoilt <= self.design.ahead + self.design.memory
        self._outputs[3:].transpose(1, 0, 2)[:, unsettled] = np.nan

    def _differentiated(self, inputs: Array) -> Array:
        """Return value, first and second derivative behind each input on the grid, shape (G, 3, columns)."""
        weights, forward, io = self.design.weights, self.design.forward, self._io
        width = weights.shape[1]
        if self._next == 0:
            io[1:] = np.outer(self.design.steady, inputs[0])
            self._smooth = np.tile(inputs[0], (width - 1, 1))
        smooth = np.concatenate([self._smooth, inputs])
        results = np.empty((len(inputs), *weights.shape[:1], inputs.shape[1]))
        for k in range(len(inputs)):
            io[0] = inputs[k]
            io = forward @ io
            smooth[width - 1 + k] = io[0]
            results[k] = weights @ smooth[k : k + width]
        self._io, self._smooth = io, smooth[len(inputs) :]
        return results

    def results(self, times: Iterable[float]) -> Array:
        """Return value, first and second derivative at the first of these instants, shape (R, 3, columns).

        `times` are the instants without a result so far; R of them are ready now.
        """
        start, period, done = self.start, self.design.period, self._next - 1 - self.design.ahead
        weights, nodes = [], []
        for time in times:
            first = max(int((time - start) / period) - 1, 0)
            if first + 3 > done:  # two grid points beyond the instant
                break
            weights.append(_weights(time, *(start + (first + k) * period for k in range(4))))
            nodes.append(first + len(self._outputs) - 1 - done)
        columns = self._outputs.shape[2]
        if not nodes:
            return np.zeros((0, 3, columns))
        outputs = self._outputs[np.array(nodes)[:, None] + _FOUR].reshape(len(nodes), 4, -1)
        return (np.array(weights)[:, None] @ outputs).reshape(len(nodes), 3, columns)


def _weights(at: float, a: float, b: float, c: float, d: float) -> tuple[float, float, float, float]:
    """Return the interpolation weights of the cubic through four nodes."""
    pa, pb, pc, pd = at - a, at - b, at - c, at - d
    return (
        pb * pc * pd / ((a - b) * (a - c) * (a - d)),
        pa * pc * pd / ((b - a) * (b - c) * (b - d)),
        pa * pb * pd / ((c - a) * (c - b) * (c - d)),
        pa * pb * pc / ((d - a) * (d - b) * (d - c)),
    )
