"""The filter with its sensitivities, run over the samples of a joint as they arrive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.recursion import LONGEST_GAP, STATE_NOISE
from joint_id_core.estimators.shared.fit_data import FitData, without_frozen
from joint_id_core.estimators.shared.initial_state import rough_states, start_state
from joint_id_core.estimators.shared.substeps import KINK, steps_to_stand

WARM_UP = 100  # samples from which the filter learns the state of the joint
# Over minutes, the creep of a sticking joint under smoothed friction would bias the estimates by several standard
# deviations. The filter follows a path that it knows well, so it can have sharper friction than a fit from afar.
SHARPER = 0.1


@dataclass(frozen=True)
class Piece:
    """What a stretch of samples says about the free parameters, in estimation coordinates z.

    Attributes:
        matrix, vector: information matrix H (k, k) and vector h (k,): the stretch alone says H z = h.
        white: innovations over their standard deviations, shape (T, labels), NaN where a label is missing.
        duration: length of the stretch in s.
    """

    matrix: Array
    vector: Array
    white: Array
    duration: float

    def __add__(self, other: Piece) -> Piece:
        return Piece(
            self.matrix + other.matrix,
            self.vector + other.vector,
            np.concatenate([self.white, other.white]),
            self.duration + other.duration,
        )


class Tracker:
    """Runs the filter at parameters that are held, the reference, and returns what new samples say about them."""

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
        """Start at the end of a window.

        Args:
            data: the window.
            kernel: compiled cell of its model.
            coordinates, z: reference of the free parameters.
            levels: noise variances of labels and inputs, shape (L,).
            substeps: integrator steps per sample.
            held: parameters that keep the value of the user, so that their friction is not sharpened.
        """
        model = data.model
        self.data, self.kernel, self.coordinates, self.levels, self.substeps = data, kernel, coordinates, levels, substeps
        self._index = np.array([model.parameter_names.index(name) for name in data.free])
        self._columns = np.array([kernel.sensitive.index(name) for name in data.free])
        self._p = data.p.copy()
        self._stiff = np.full(len(model.states), -1.0)
        for velocity, name in model.smoothing.items():
            i = model.parameter_names.index(name)
            if name not in held and name not in data.free and not model.smoothing_share:
                self._p[i] *= SHARPER
            self._stiff[model.state_names.index(velocity)] = KINK * self._p[i]
        self._n, self._k = len(model.states), len(kernel.sensitive)
        self._kept = np.zeros((self._n, 1 + self._n + self._k))
        self.move(z)
        self._many = steps_to_stand(data, kernel, self._p, rough_states(data), substeps)
        self._start()

    def move(self, z: Array) -> None:
        """Take other reference parameters; the state follows along its derivatives."""
        before = self._p[self._index]
        self.z, after = z, self.coordinates.values(z)
        self._p[self._index] = after
        self._slope = self.coordinates.slope(z)
        self._kept[:, 0] += self._kept[:, 1 + self._n + self._columns] @ (after - before)

    def _start(self) -> None:
        """Learn the state from the end of the window."""
        data = self.data
        first = max(0, len(data.time) - WARM_UP)
        mean, spread = start_state(data, first, self._p)
        self._kept[:] = 0.0
        self._kept[:, 0] = mean
        self._kept[:, 1 : 1 + self._n] = np.diag(spread**2)
        self._noise = STATE_NOISE * spread**2
        self._last = (data.time[first], data.u[first])
        self._run(data.time[first + 1 :], data.u[first + 1 :], data.y[first + 1 :])

    def read(self, samples: Recording) -> tuple[Array, Array, Array] | None:
        """Return time (T,), inputs (T, inputs) and labels (T, labels); None if the signals are others than before."""
        model, labels = self.data.model, self.data.labels
        count, columns = len(samples), []
        for name in model.input_names:
            if name in samples:
                columns.append(samples.channels[name])
            elif name in model.optional_inputs:
                columns.append(np.zeros(count))
            else:
                return None
        seen = [name for name in model.state_names if name in samples and name not in samples.derived]
        if any(name not in labels for name in seen):
            return None
        u = np.array(columns).T.copy()
        y = np.array([samples.channels[n] if n in seen else np.full(count, np.nan) for n in labels])
        y, time = without_frozen(y).T.copy(), samples.time
        usable = np.isfinite(u).all(axis=1)
        return (time, u, y) if usable.all() else (time[usable].copy(), u[usable], y[usable])

    def run(self, time: Array, u: Array, y: Array) -> Piece | None:
        """Run over new samples; None if the path diverges or a gap is too long: then start a new tracker."""
        before = self._last[0]
        steps = np.diff(time, prepend=before)
        if len(time) and steps.max() > (1.5 + LONGEST_GAP) * self.data.period:
            return None
        found = self._run(time, u, y)
        if found is None:
            return None
        H, g, white = found
        H = H[self._columns[:, None], self._columns] * np.outer(self._slope, self._slope)
        g = g[self._columns] * self._slope
        return Piece(H, g + H @ self.z, white, float(self._last[0] - before))

    def _run(self, time: Array, u: Array, y: Array) -> tuple[Array, Array, Array] | None:
        if not len(time):
            return np.zeros((self._k, self._k)), np.zeros(self._k), np.empty((0, y.shape[1]))
        m = len(self.data.labels)
        time = np.concatenate([[self._last[0]], time])
        u = np.concatenate([self._last[1][None], u])
        y = np.concatenate([np.full((1, m), np.nan), y])
        gap = np.zeros(len(time))
        gap[:-1] = np.maximum(np.rint(np.diff(time) / self.data.period) - 1.0, 0.0)
        H, g, white = np.empty((self._k, self._k)), np.empty(self._k), np.empty((len(time), m))
        cost = self.kernel.tracking.track(
            self._kept, time, u, y, self.data.label_states, gap, self.levels[:m], self.levels[m:], self._noise,
            self._p, self.substeps, self._stiff, self._many, white, H, g,
        )  # fmt: skip
        self._last = (float(time[-1]), u[-1])
        return (H, g, white[1:]) if np.isfinite(cost) else None
