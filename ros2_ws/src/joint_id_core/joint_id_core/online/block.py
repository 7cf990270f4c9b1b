"""Consecutive samples of one joint that pass through the filter with the same parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array
from joint_id_core.online.piece import Piece, Samples, State

SAMPLES = ("time", "gap", "u", "y", "errors", "variances", "white")  # arrays with a row a sample
STORED = ("gains", "slopes", "shown", "sensitivities")  # and those that only `noise_information` needs


MOST = 1e25  # information of half a second on a coordinate: a standard deviation of 3e-13


class Sizes(NamedTuple):
    """Numbers of states, inputs, labels, sensitivities and free parameters; whether a label has a delay."""

    states: int
    inputs: int
    labels: int
    parameters: int
    free: int
    delayed: bool


class Block:
    """Samples, what `loops.tracking.track` finds of them, and what they say about the free parameters.

    It grows: the arrays have room for samples that are still to come, so that nothing is joined when it is complete.

    Args:
        begin: state of the filter before the samples.
        z: parameters at which the filter runs, shape (k,).
        smoothing: of its friction, relative to that of a fit.
        levels: noise variances, shape (L,).
        sizes: of the model.
        rows: samples for which there is room at the begin.
        unstored: what `gains`, `slopes`, `shown` and `sensitivities` are where they are not stored, with one row each;
            None stores them.

    Attributes:
        count: number of samples that passed; row 0 of all arrays is the sample before them.
        cost: their share of the cost; NaN if the path diverged.
        kept, errors, variances, gains, slopes, shown, sensitivities, score: as of `loops.tracking.track`.
        time, u, y, gap, white, matrix, vector: likewise.
        largest: innovation, in standard deviations, shape (1,).
    """

    def __init__(
        self,
        begin: State,
        z: Array,
        smoothing: float,
        levels: Array,
        sizes: Sizes,
        rows: int,
        unstored: tuple[Array, Array, Array, Array] | None = None,
    ) -> None:
        m, rows = sizes.labels, rows + 1
        self.begin, self.z, self.smoothing, self.levels = begin, z, smoothing, levels
        self.stored = unstored is None
        self.count, self.cost, self.kept = 0, 0.0, begin.kept.copy()
        self.time, self.gap = np.zeros(rows), np.zeros(rows)
        self.u, self.y = np.zeros((rows, sizes.inputs)), np.zeros((rows, m))
        self.errors, self.variances, self.white = np.zeros((rows, m)), np.ones((rows, m)), np.zeros((rows, m))
        self.gains, self.slopes, self.shown, self.sensitivities = unstored or room(sizes, rows)
        self.matrix, self.vector = np.zeros((sizes.free, sizes.free)), np.zeros(sizes.free)
        self.score, self.largest = np.zeros(sizes.parameters), np.zeros(1)
        self.time[0], self.u[0], self.y[0] = begin.time, begin.u, np.nan

    @property
    def diverged(self) -> bool:
        """Whether the path of the filter diverged, or nearly so: no samples say that much."""
        return not np.isfinite(self.cost) or not self.matrix.trace() < MOST

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.time[self.count]) - self.begin.time

    @property
    def end(self) -> State:
        """State of the filter after the samples."""
        return State(self.kept, float(self.time[self.count]), self.u[self.count].copy())

    def put(self, signals: Array, times: Array, period: float, checked: bool = False) -> float:
        """Write samples that are to pass next; return the longest step, as `loops.hop.lead`, which tells the rest."""
        times = np.ascontiguousarray(times)  # they may be a column of a table
        missing = self.count + 1 + len(times) - len(self.time)
        if missing > 0:
            self._grow(max(missing, len(self.time)))
        return float(
            compile_shared().lead(
                signals, times, period, float(checked), self.count, self.time, self.u, self.y, self.gap
            )
        )

    def _grow(self, rows: int) -> None:
        have = len(self.time)
        for name in (*SAMPLES, *(STORED if self.stored else ())):
            old = getattr(self, name)
            if len(old) == have:  # not what is stored of a label without delay
                more = np.full((rows, *old.shape[1:]), float(name == "variances"))
                setattr(self, name, np.concatenate([old, more]))

    def piece(self) -> Piece:
        """Return what the samples say."""
        rows = slice(1, 1 + self.count)
        samples = Samples(self.time[rows], self.u[rows], self.y[rows])
        return Piece(
            self.matrix.copy(), self.vector.copy(), self.white[rows], self.begin, samples, self.z, self.smoothing,
            self.levels, float(self.largest[0]), self if self.stored else None,
        )  # fmt: skip


def room(sizes: Sizes, rows: int) -> tuple[Array, Array, Array, Array]:
    """Return gains, slopes, derivatives of the readings and sensitivities for `track` to fill."""
    n, m = sizes.states, sizes.labels
    shown = (rows, m, n) if sizes.delayed else (1, 1, 1)
    return (
        np.zeros((rows, m, n)), np.zeros((rows, n, n + sizes.inputs)), np.zeros(shown),
        np.zeros((rows, m, sizes.parameters)),
    )  # fmt: skip
