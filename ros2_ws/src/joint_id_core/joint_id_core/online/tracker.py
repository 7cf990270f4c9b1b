"""The filter with its sensitivities, run over the samples of a joint as they arrive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from joint_id_core.cell.kernel import Kernel, compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.input_noise import shown_noise
from joint_id_core.estimators.innovations.recursion import STATE_NOISE
from joint_id_core.estimators.shared.fit_data import LONGEST_GAP, SETTLE_S, FitData, without_frozen
from joint_id_core.estimators.shared.initial_state import start_state
from joint_id_core.online.piece import Passed, Piece, Samples, State
from joint_id_core.online.sharpness import Friction, Sharpness

LEAST = 10  # samples of the shortest motion that is used
UNSURE = 1e4  # factor on the covariance of the state where parameters changed


class _Led(NamedTuple):
    """Samples as `loops.tracking.track` takes them, the first row the sample before, and the longest step in s."""

    time: Array
    u: Array
    y: Array
    gap: Array
    longest: float


class Tracker:
    """Runs the filter at parameters that are held, the reference, and returns what new samples say about them.

    Attributes:
        columns: of the free parameters in what the filter stores, shape (k,).
        shown_noise: noise variance that each measured input shows, by index.
    """

    def __init__(
        self,
        data: FitData,
        kernel: Kernel,
        coordinates: Coordinates,
        z: Array,
        levels: Array,
        substeps: int,
        held: frozenset[str] = frozenset(),
    ) -> None:
        """Prepare; `start` begins.

        Args:
            data: the window.
            kernel: compiled cell of its model.
            coordinates, z: reference of the free parameters.
            levels: noise variances of labels and inputs, shape (L,).
            substeps: integrator steps per sample.
            held: parameters that keep the value of the user, so that their friction is not sharpened.
        """
        model = data.model
        self.data, self.kernel, self.coordinates = data, kernel, coordinates
        self.levels, self.substeps = levels, substeps
        self._index = np.array([model.parameter_names.index(name) for name in data.free])
        self.columns = np.array([kernel.sensitive.index(name) for name in data.free])
        self._p = data.p.copy()
        self._sharpness = Sharpness(data, kernel, substeps, held)
        self._n, self._m, self._k = len(model.states), len(data.labels), len(kernel.sensitive)
        self._unseen = [name for name in model.state_names if name not in data.labels]
        self._state = State(np.zeros((self._n, 2 + self._n + self._k)), -np.inf, np.zeros(len(model.inputs)))
        self._unstored = self._room(1)
        self._take(z)
        self.shown_noise = shown_noise(data)
        self._smooth = self._sharpness.smoothed(1.0, self._p)
        self._use(self._smooth)

    def sharpen(self, sigma: float) -> None:
        """Take friction as sharp as suits the largest standard deviation `sigma` of a coordinate."""
        self._use(self._sharpness.of(sigma, self._p))

    def _use(self, friction: Friction) -> None:
        self._now = friction
        self._p[self._sharpness.sharpened] = friction.velocities

    @property
    def smoothing(self) -> float:
        """Smoothing of friction over that of a fit."""
        return self._now.smoothing

    def move(self, z: Array) -> None:
        """Take other reference parameters; the state follows along its derivatives."""
        before = self.z
        self._take(z)
        self._state = replace(self._state, kept=self._moved(self._state.kept, before))

    def _moved(self, kept: Array, z: Array) -> Array:
        """Return a state at parameters z (k,) as that at the reference, along its derivatives."""
        moved = kept.copy()
        moved[:, 0] += kept[:, 1 + self._n + self.columns] @ (self._p[self._index] - self.coordinates.values(z))
        return moved

    def _unsure(self, kept: Array) -> Array:
        """Return a state that says little about the one after a change of the parameters."""
        unsure = kept.copy()
        unsure[:, 1 + self._n : -1] = 0.0
        unsure[:, 1 : 1 + self._n] *= UNSURE
        return unsure

    def _take(self, z: Array) -> None:
        self.z, self._slope = z, self.coordinates.slope(z)
        self._p[self._index] = self.coordinates.values(z)

    def start(self) -> list[Piece] | None:
        """Start where the window begins, and return what its samples say.

        Every motion after a rest is a piece. None if a path diverges.

        The first `SETTLE_S` of each are left out.
        """
        data, found = self.data, list[Piece]()
        edges = np.unique([0, *data.starts, len(data.time)])
        for begin, end in pairwise(edges.tolist()):
            rest = np.flatnonzero(data.rest[begin:end])
            if len(rest):
                end = begin + int(rest[0])
            settled = max(begin + 1, int(np.searchsorted(data.time, data.time[begin] + SETTLE_S)))
            if end - settled < LEAST:
                continue
            mean, spread = start_state(data, begin, self._p)
            kept = np.zeros((self._n, 2 + self._n + self._k))
            kept[:, 0] = kept[:, -1] = mean
            kept[:, 1 : 1 + self._n] = np.diag(spread**2)
            self._noise = STATE_NOISE * spread**2
            self._state = State(kept, float(data.time[begin]), np.ascontiguousarray(data.u[begin]))
            first, then = (
                Samples(*map(np.ascontiguousarray, (data.time[rows], data.u[rows], data.y[rows])))
                for rows in (slice(begin + 1, settled), slice(settled, end))
            )
            start = self._settled((self._state, first))
            if start is None:
                return None
            self._state = start
            piece = self.run(then)
            if piece is None:
                return None
            found.append(piece)
        return found

    def read(self, samples: Recording) -> Samples | None:
        """Return the signals of a recording that the filter needs; None if it holds others than before."""
        signals = self._signals(samples)
        if signals is None:
            return None
        rows, count, inputs = np.array(signals), len(samples), len(self.data.model.inputs)
        time, u, y = np.ascontiguousarray(samples.time), np.empty((count, inputs)), np.empty((count, self._m))
        if compile_shared().arrange(rows, u, y):  # nearly always
            return Samples(time, u, y)
        y, usable = without_frozen(rows[inputs:]).T, np.isfinite(u).all(axis=1)
        return Samples(time[usable], u[usable], y[usable].copy())

    def _signals(self, samples: Recording) -> list[Array] | None:
        """Return the inputs, then the labels, each of shape (T,); None if there are others than before."""
        model, channels, derived, found = self.data.model, samples.channels, samples.derived, list[Array]()
        for name in model.input_names:
            if name in channels:
                found.append(channels[name])
            elif name in model.optional_inputs:
                found.append(np.zeros(len(samples)))
            else:
                return None
        for name in self._unseen:
            if name in channels and name not in derived:
                return None
        for name in self.data.labels:
            seen = name in channels and name not in derived
            found.append(channels[name] if seen else np.full(len(samples), np.nan))
        return found

    def run(self, samples: Samples) -> Piece | None:
        """Run over new samples; None if the path diverges or a gap is too long: then start a new tracker."""
        found = self._run(self._state, samples, (1.5 + LONGEST_GAP) * self.data.period, stored=True)
        if found is None:
            return None
        self._state = found[0]
        return found[2]

    def again(self, pieces: Sequence[Piece], z: Array, changed: bool = False) -> tuple[Array, list[Piece]] | None:
        """Run over stretches again at another reference; return the cost of each and what it says now.

        With `changed` parameters the derivatives of the state at the begin are zero. None if the path diverges. The
        filter then stands at the end of the last stretch.
        """
        self._take(z)
        costs, found = list[float](), list[Piece]()
        for k, piece in enumerate(pieces):
            goes_on = k and piece.begin.time == pieces[k - 1].samples.time[-1]
            begin = self._state if goes_on else self._begin(piece, changed)
            done = None if begin is None else self._run(begin, piece.samples)
            if done is None:
                return None
            self._state, cost, new = done
            costs.append(cost)
            found.append(new)
        return np.array(costs), found

    def _begin(self, piece: Piece, changed: bool) -> State | None:
        """Return the state at the begin of a stretch, at the present reference; None if the path diverges."""
        begin = piece.begin
        if begin.start is not None:
            return self._settled(begin.start)
        return replace(begin, kept=self._unsure(begin.kept) if changed else self._moved(begin.kept, piece.z))

    def _settled(self, start: tuple[State, Samples]) -> State | None:
        """Return the state after the first samples; None if the path diverges.

        Friction is smooth there. Sharp friction holds a velocity that began near zero, and leaves labels no say in it.
        """
        sharp = self._now
        self._use(self._smooth)
        done = self._run(*start)
        self._use(sharp)
        return None if done is None else replace(done[0], start=start)

    def passed_again(self, piece: Piece, levels: Array, stored: bool = False) -> Passed:
        """Run over a stretch at its own reference, with noise levels (L,); the filter stays where it is.

        With `stored`, keep what `loops.innovations.noise_information` needs.
        """
        here = self.levels, self.z
        self.levels = levels
        self._take(piece.z)
        found = self._passed(piece.begin, self._led(piece.begin, piece.samples), stored)
        self.levels, z = here
        self._take(z)
        return found

    def _run(
        self, begin: State, samples: Samples, longest: float = np.inf, stored: bool = False
    ) -> tuple[State, float, Piece] | None:
        """Return state, cost and result; None if the path diverges or a step is longer than `longest` (s).

        `stored` as in `passed_again`.
        """
        led = self._led(begin, samples)
        if led.longest > longest:
            return None
        found = self._passed(begin, led, stored)
        if not np.isfinite(found.cost):
            return None
        k = len(self.z)
        matrix, vector, white = np.empty((k, k)), np.empty(k), np.empty_like(samples.y)
        largest = compile_shared().of_free(
            found.matrix, found.score, self.columns, self._slope, self.z, found.errors, found.variances, found.y,
            matrix, vector, white,
        )  # fmt: skip
        state, passed = State(found.kept, float(led.time[-1]), led.u[-1]), found if stored else None
        return state, found.cost, Piece(matrix, vector, white, begin, samples, self.z, self.smoothing, largest, passed)

    def _led(self, begin: State, samples: Samples) -> _Led:
        """Return samples with the one before them."""
        rows, (inputs, labels) = len(samples.time) + 1, (samples.u.shape[1], samples.y.shape[1])
        time, u, y, gap = np.empty(rows), np.empty((rows, inputs)), np.empty((rows, labels)), np.empty(rows)
        longest = compile_shared().lead(
            begin.time, begin.u, samples.time, samples.u, samples.y, self.data.period, time, u, y, gap
        )
        return _Led(time, u, y, gap, longest)

    def _room(self, rows: int) -> tuple[Array, Array, Array, Array]:
        """Return gains, slopes, derivatives of the readings and sensitivities for `track` to fill."""
        m, k, n = self._m, self._k, self._n
        shown = (rows, m, n) if self.data.model.label_delays else (1, 1, 1)
        slopes = (rows, n, n + len(self.data.model.inputs))
        return np.zeros((rows, m, n)), np.zeros(slopes), np.empty(shown), np.zeros((rows, m, k))

    def _passed(self, begin: State, led: _Led, stored: bool = False) -> Passed:
        """Run over samples; `stored` as in `passed_again`."""
        m, k, rows = self._m, self._k, len(led.time)
        e, S = np.zeros((rows, m)), np.ones((rows, m))
        K, F, C, J = self._room(rows) if stored else self._unstored
        kept, H, g = begin.kept.copy(), np.empty((k, k)), np.empty(k)
        cost = self.kernel.tracking.track(
            kept, led.time, led.u, led.y, self.data.label_states, led.gap, self.levels[:m], self.levels[m:],
            self._noise, self._p, self.substeps, self._now.stiff, self._now.many, e, S, K, F, C, J, H, g,
        )  # fmt: skip
        return Passed(float(cost), kept, led.y, e, S, K, F, C, J, H, g)
