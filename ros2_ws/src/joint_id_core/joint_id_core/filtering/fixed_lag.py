"""The core of the streaming filter: state of the forward filter, buffer of fixed lag, and weights over this buffer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy  # whose parts load when used: scipy.signal takes half a second
from numpy.lib.stride_tricks import sliding_window_view
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
        self._times = np.zeros(0)
        self._rows = np.zeros((0, columns))
        self._bad_rows = np.zeros((0, columns), dtype=bool)
        self._io = np.zeros((len(design.forward), columns))
        self._smooth = np.zeros((0, columns))  # newest outputs of the forward filter, as many as the weights need
        self._outputs = np.full((3, 3, columns), np.nan)  # value, first and second derivative at the newest grid points
        self._spoilt = np.zeros(columns, dtype=np.int64)  # grid index of the last unusable input, at first the start
        self._next = 0  # grid index of the next input

    def take(self, times: Array, rows: Array, bad: NDArray[np.bool_]) -> None:
        """Add samples, shapes (T,), (T, columns), and advance; a value that is not finite is replaced by the previous.

        Call `results` with the instants that wait before the next samples are taken.
        """
        if bad.any():
            rows, last = rows.copy(), self._rows[-1] if len(self._rows) else np.zeros(rows.shape[1])
            for row, unusable in zip(rows, bad, strict=True):
                row[unusable] = last[unusable]
                last = row
        self.bad = bad[-1]
        times, rows = np.concatenate([self._times, times]), np.concatenate([self._rows, rows])
        bad = np.concatenate([self._bad_rows, bad])
        self._advance(times, rows, bad)
        self._times, self._rows, self._bad_rows = times[-3:], rows[-3:], bad[-3:]

    def _advance(self, times: Array, rows: Array, bad: NDArray[np.bool_]) -> None:
        """Filter up to the last grid point that has two samples behind it."""
        if len(times) < 4:
            return
        reach = int((times[-2] - self.start) / self.design.period) + 2
        indices = np.arange(self._next, max(reach, self._next))
        at = self.start + indices * self.design.period
        indices = indices[at < times[-2]]
        if not len(indices):
            return
        at = at[: len(indices)]
        nodes = np.maximum(np.searchsorted(times, at, "right"), 2)[:, None] + np.arange(-2, 2)
        x = (_weights(at, times[nodes])[:, None] @ rows[nodes])[:, 0]
        self._outputs = np.concatenate([self._outputs[-3:], self._differentiated(x)])
        self._next += len(indices)
        spoilt = np.broadcast_to(self._spoilt, x.shape)
        if bad.any():
            seen = np.where(bad[nodes].any(axis=1), indices[:, None], self._spoilt)
            spoilt = np.maximum.accumulate(seen)
            self._spoilt = spoilt[-1]
        unsettled = indices[:, None] - spoilt <= self.design.ahead + self.design.memory
        if unsettled.any():
            self._outputs[3:].transpose(1, 0, 2)[:, unsettled] = np.nan

    def _differentiated(self, x: Array) -> Array:
        """Return value, first and second derivative behind each input on the grid, shape (G, 3, columns)."""
        width = self.design.weights.shape[1]
        if self._next == 0:
            self._io[1:] = np.outer(self.design.steady, x[0])
            self._smooth = np.tile(x[0], (width - 1, 1))
        smooth = np.concatenate([self._smooth, x])
        io, forward = self._io, self.design.forward
        for row in smooth[width - 1 :]:
            io[0] = row
            io = forward @ io
            row[:] = io[0]
        self._io, self._smooth = io, smooth[len(x) :]
        windows = sliding_window_view(smooth, width, axis=0).transpose(0, 2, 1)
        return self.design.weights @ windows

    def results(self, times: Array) -> Array:
        """Return value, first and second derivative at the first of these instants, shape (R, 3, columns).

        `times`, shape (T,), are the instants without a result so far; R of them are ready now.
        """
        first = np.maximum(((times - self.start) / self.design.period).astype(np.int64) - 1, 0)
        ready = first + 3 <= self._next - 1 - self.design.ahead  # two grid points beyond the instant
        nodes = first[ready][:, None] + np.arange(4)
        weights = _weights(times[ready], self.start + nodes * self.design.period)
        outputs = self._outputs[nodes + (self.design.ahead + len(self._outputs) - self._next)]
        return np.einsum("rk,rkdc->rdc", weights, outputs)


def _weights(at: Array, nodes: Array) -> Array:
    """Return the interpolation weights of cubics through four nodes each, shapes (n,) and (n, 4), result (n, 4)."""
    a, b, c, d = nodes.T
    pa, pb, pc, pd = at - a, at - b, at - c, at - d
    return np.stack(
        [
            pb * pc * pd / ((a - b) * (a - c) * (a - d)),
            pa * pc * pd / ((b - a) * (b - c) * (b - d)),
            pa * pb * pd / ((c - a) * (c - b) * (c - d)),
            pa * pb * pc / ((d - a) * (d - b) * (d - c)),
        ],
        axis=-1,
    )
