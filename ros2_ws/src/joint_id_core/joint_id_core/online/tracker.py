"""The filter with its sensitivities, run over the samples of a joint as they arrive."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.input_noise import shown_noise
from joint_id_core.estimators.innovations.recursion import STATE_NOISE
from joint_id_core.estimators.shared.fit_data import LONGEST_GAP, SETTLE_S, FitData, without_frozen
from joint_id_core.online.beginnings import LEAST, at_labels, begun_anew
from joint_id_core.online.block import Block, Sizes, room
from joint_id_core.online.curved_stream import CurvedStream
from joint_id_core.online.memory import BLOCK_S
from joint_id_core.online.piece import Piece, Samples, State
from joint_id_core.online.sharpness import Friction, Sharpness


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
        self._sizes = Sizes(self._n, len(model.inputs), self._m, self._k, len(self.columns), bool(model.label_delays))
        self._unseen = [name for name in model.state_names if name not in data.labels]
        self._curved = CurvedStream(model, data.recording)
        self._usual: tuple[object, ...] = ()  # channels, and which of them are derived, that hold all signals
        self._state = State(np.zeros((self._n, 1 + self._n + self._k)), -np.inf, np.zeros(len(model.inputs)))
        self._unstored = room(self._sizes, 1)
        self._longest = (1.5 + LONGEST_GAP) * data.period  # step in s that the filter can bridge
        self._take(z)
        self.shown_noise = shown_noise(data)
        self._smooth = self._sharpness.smoothed(1.0, self._p)
        self._use(self._smooth)

    def copy(self) -> Tracker:
        """Return one that runs by itself from here."""
        other = copy(self)
        other._p, other._unstored, other._curved = self._p.copy(), room(self._sizes, 1), self._curved.copy()
        return other

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

    def _take(self, z: Array) -> None:
        self.z, self._slope = z, self.coordinates.slope(z)
        self._p[self._index] = self.coordinates.values(z)

    def start(self) -> list[Block] | None:
        """Start where the window begins, and return what its samples say; the last block may grow.

        Every motion after a rest is a block. None if a path diverges.

        The first `SETTLE_S` of each are left out.
        """
        data, found = self.data, list[Block]()
        edges = np.unique([0, *data.starts, len(data.time)])
        for begin, end in pairwise(edges.tolist()):
            rest = np.flatnonzero(data.rest[begin:end])
            if len(rest):
                end = begin + int(rest[0])
            settled = max(begin + 1, int(np.searchsorted(data.time, data.time[begin] + SETTLE_S)))
            if end - settled < LEAST:
                continue
            start = at_labels(data, self._p, slice(begin, settled), self._k)
            self._noise = STATE_NOISE * np.diag(start[0].kept[:, 1 : 1 + self._n])
            state = self._settled(start)
            if state is None:
                return None
            self._state = state
            block, rows = self.begin(end - settled), slice(settled, end)
            if not self._put(block, Samples(data.time[rows], data.u[rows], data.y[rows]), self._longest):
                return None
            self._state = block.end
            found.append(block)
        return found

    def begin(self, more: int = 0) -> Block:
        """Return a block without samples where the filter stands, with room for a block and for `more` samples."""
        return self._block(self._state, more + round(1.5 * BLOCK_S / self.data.period), stored=True)

    def run(self, samples: Recording, block: Block) -> bool:
        """Run over new samples, which are added to the block.

        Return whether this could be done. If not, start a new tracker: the path diverges, a gap is too long, or there
        are other signals than before.
        """
        signals = self._signals(samples)
        if signals is None:
            return False
        self._curved.take(samples.time, signals)
        count = len(samples.time)
        longest = block.put(signals, samples.time, self.data.period)
        if longest != longest:  # hardly ever
            inputs = self._sizes.inputs
            usable = np.isfinite(signals[:inputs]).all(axis=0)
            signals[inputs:] = without_frozen(signals[inputs:])
            signals, count = np.ascontiguousarray(signals[:, usable]), int(np.count_nonzero(usable))
            longest = block.put(signals, samples.time[usable], self.data.period, checked=True)
        return longest <= self._longest and self._advance(block, count)

    def end(self, block: Block) -> Piece:
        """Go on from the end of a block, and return what it says."""
        self._state = block.end
        return block.piece()

    def _signals(self, samples: Recording) -> Array | None:
        """Return the inputs and the labels, shape (inputs + labels, T); None if there are others than before."""
        model, channels, derived = self.data.model, samples.channels, samples.derived
        kind = (*channels, derived)
        if kind == self._usual:  # nearly always
            return np.array([channels[name] for name in (*model.input_names, *self.data.labels)])
        found = list[Array]()
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
        seen = [name for name in self.data.labels if name in channels and name not in derived]
        found += [channels[name] if name in seen else np.full(len(samples), np.nan) for name in self.data.labels]
        if seen == list(self.data.labels) and all(name in channels for name in model.input_names):
            self._usual = kind
        return np.array(found)

    def since_change(self, pieces: Sequence[Piece]) -> list[Piece]:
        """Return stretches after a change of the parameters, of which the first begins anew at its labels.

        The filter was at the parameters before the change, so what it found of the state may be far off. Empty if the
        stretches are too short.
        """
        for k, piece in enumerate(pieces):
            if piece.begin.start is not None:  # begins at its labels
                return list(pieces[k:])
            anew = begun_anew(self.data, self._p, piece, self._k)
            if anew is not None:
                return [anew, *pieces[k + 1 :]]
        return []

    def again(self, pieces: Sequence[Piece], z: Array) -> tuple[Array, list[Piece]] | None:
        """Run over stretches again at another reference; return the cost of each and what it says now.

        None if the path diverges. The filter then stands at the end of the last stretch.
        """
        self._take(z)
        costs, found = list[float](), list[Piece]()
        for k, piece in enumerate(pieces):
            goes_on = k and piece.begin.time == pieces[k - 1].samples.time[-1]
            begin = self._state if goes_on else self._begin(piece)
            block = None if begin is None else self._passed(begin, piece.samples)
            if block is None or block.diverged:
                return None
            self._state = block.end
            costs.append(block.cost)
            found.append(block.piece())
        return np.array(costs), found

    def _begin(self, piece: Piece) -> State | None:
        """Return the state at the begin of a stretch, at the present reference; None if the path diverges."""
        begin = piece.begin
        if begin.start is not None:
            return self._settled(begin.start)
        return replace(begin, kept=self._moved(begin.kept, piece.z))

    def _settled(self, start: tuple[State, Samples]) -> State | None:
        """Return the state after the first samples; None if the path diverges.

        Friction is smooth there. Sharp friction holds a velocity that began near zero, and leaves labels no say in it.
        """
        sharp = self._now
        self._use(self._smooth)
        block = self._passed(*start)
        self._use(sharp)
        return replace(block.end, start=start) if np.isfinite(block.cost) else None

    def passed_again(self, piece: Piece, levels: Array, stored: bool = False) -> Block:
        """Run over a stretch at its own reference, with noise levels (L,); the filter stays where it is.

        With `stored`, keep what `loops.innovations.noise_information` needs.
        """
        here = self.levels, self.z
        self.levels = levels
        self._take(piece.z)
        found = self._passed(piece.begin, piece.samples, stored)
        self.levels, z = here
        self._take(z)
        return found

    def passed_sharper(self, piece: Piece, factor: float) -> Block:
        """Run over a stretch as `passed_again` does, with smoothing velocities of friction over `factor`."""
        here = self._now
        self._use(self._sharpness.smoothed(here.smoothing / factor, self._p))
        found = self.passed_again(piece, self.levels)
        self._use(here)
        return found

    @property
    def sharpened(self) -> bool:
        """Whether friction is smoothed, and may be sharper."""
        return bool(self._sharpness.sharpened)

    def _passed(self, begin: State, samples: Samples, stored: bool = False) -> Block:
        """Run over samples; `stored` as in `passed_again`."""
        block = self._block(begin, len(samples.time), stored)
        self._put(block, samples)
        return block

    def _block(self, begin: State, rows: int, stored: bool) -> Block:
        return Block(begin, self.z, self.smoothing, self.levels, self._sizes, rows, None if stored else self._unstored)

    def _put(self, block: Block, samples: Samples, longest: float = np.inf) -> bool:
        """Run over samples that can be used as they are; return whether the path stays finite.

        False as well if a step is longer than `longest` (s).
        """
        signals = np.ascontiguousarray(np.concatenate([samples.u.T, samples.y.T]))
        step = block.put(signals, samples.time, self.data.period, checked=True)
        return step <= longest and self._advance(block, len(samples.time))

    def _advance(self, block: Block, count: int) -> bool:
        """Run over the next samples of a block; return whether the path stays finite."""
        m, now = self._m, self._now
        cost = self.kernel.tracking.track(
            block.kept, block.time, block.u, block.y, self.data.label_states, block.gap, self.levels[:m],
            self.levels[m:], self._noise, self._p, self.substeps, now.stiff, now.many, now.turning, now.most,
            block.count, count, self.columns, self._slope, self.z, block.errors, block.variances, block.gains,
            block.slopes, block.shown, block.sensitivities, block.score, block.matrix, block.vector, block.white,
            block.largest,
        )  # fmt: skip
        block.count += count
        block.cost += cost
        return bool(cost < np.inf)
