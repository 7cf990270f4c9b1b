"""What the samples so far say about the parameters, and stretches of new samples against it.

Information adds up: each stretch of samples contributes an information matrix H and a vector h in estimation
coordinates, and the estimate solves (sum H) z = sum h. Older information is forgotten exponentially.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.online.doubt import LEAST, Doubt
from joint_id_core.online.piece import Piece
from joint_id_core.online.score_test import Stretch, changed_parameters, stretches
from joint_id_core.online.symmetric import inverse_of, solve
from joint_id_core.results.estimate import Estimate

BLOCK_S = 0.5  # length of a block
HISTORY = 128  # blocks that can be passed through the filter again, where little is known yet
LENGTHS = (1, 2, 4, 8, 16, 32, 64, HISTORY)  # blocks of the stretches that are tested
LEARNED = 32  # blocks from which new values are learned, at most: what only more of them show is a drift, not a step
# Of the stretches that give doubt; the longer ones are one second apart, and four beyond `LEARNED`.
SCANNED = (1, 2, 4, *range(6, LEARNED + 1, 2), *range(LEARNED + 8, HISTORY + 1, 8))
RARE = 1e-7  # probability of one test to find a change where there is none
SELDOM = 1.0 - 0.5 * RARE  # quantile of a single parameter
AGAIN = 1e-4  # the same for all stretches since a change: where one parameter changed, others often did
WINDOW_BLOCKS = 4  # blocks of a stretch for the scatter
FIRM = 8.0  # stretches without scatter that are assumed before the first one
REMEMBERED = 60.0  # stretches after which the scatter of an older one is forgotten


@dataclass(frozen=True)
class Change:
    """A change of parameters that the samples show.

    Attributes:
        names: parameters that changed, the most significant first, as indices of the free parameters.
        likely: further parameters that may have changed.
        blocks: the newest blocks, `LEARNED` at most; the change happened in the first of them, or it began before them
            and goes on.
        mean, covariance: what was known before, shapes (k,) and (k, k), in estimation coordinates.
        size: of the most significant one, in standard deviations.
    """

    names: tuple[int, ...]
    likely: tuple[int, ...]
    blocks: tuple[Piece, ...]
    mean: Array
    covariance: Array
    size: float

    def still_known(self, spread: Array) -> tuple[Array, Array]:
        """Return mean (k,) and precision (k, k) of what is still known: changed parameters get their `spread` (k,)."""
        wide = np.zeros(len(spread))
        changed = [*self.names, *self.likely]
        wide[changed] = spread[changed]
        return self.mean, inverse_of(self.covariance + np.diag(wide**2))


@dataclass(frozen=True)
class _Step:
    """A block of samples with the memory before it.

    `matrix` (k, k), `vector` (k,) and `noise` (k, k) are sums of information, of vectors, and the covariance of these;
    `precision` (k, k) is the inverse of the covariance of the estimate, and `weighted` (k,) that times the estimate.
    """

    matrix: Array
    vector: Array
    noise: Array
    precision: Array
    weighted: Array
    block: Piece


class Memory:
    """Information on the free parameters of one joint.

    Attributes:
        wider: factor on the standard deviation of each parameter that its scatter asks for, at least 1, shape (k,).
        unsure: factor on the squares that the test allows for noise levels that are hardly known, of each parameter and
            of all, shape (k + 1,).
        doubt: what changes that the test does not show yet may add to the covariance of the estimate, shape (k, k).
    """

    def __init__(self, z: Array, covariance: Array, spread: Array, changed: bool = False) -> None:
        """Begin with an estimate.

        Args:
            z, covariance: estimate and its covariance, shapes (k,) and (k, k), in estimation coordinates.
            spread: prior standard deviations (k,); forgetting never widens beyond them.
            changed: whether the joint has just changed; what was kept is then tested more strictly.
        """
        self._changed = changed
        self.matrix = np.asarray(np.linalg.inv(covariance), dtype=float)
        self.vector = self.matrix @ z
        self._noise = self.matrix  # covariance of the vector: forgotten twice as fast
        self._least = np.diag(np.power(spread, -2.0))
        self._blocks: deque[_Step] = deque(maxlen=HISTORY)
        self._scatter = np.zeros(len(z) + 1)  # sums of squares of normal numbers: of each parameter, and of all
        self._stretches = 0.0
        self._since = 0
        self.wider, self.unsure = np.ones(len(z)), np.ones(len(z) + 1)
        self._solved: tuple[Array, Array] | None = None  # mean and inverse of `matrix`
        self.doubt = np.zeros_like(self.matrix)

    def _solve(self) -> tuple[Array, Array]:
        if self._solved is None:
            self._solved = solve(self.matrix, self.vector), inverse_of(self.matrix)
        return self._solved

    @property
    def mean(self) -> Array:
        """Present estimate, shape (k,)."""
        return self._solve()[0]

    @property
    def covariance(self) -> Array:
        """Covariance of the estimate, shape (k, k), widened by the scatter of stretches that share no sample."""
        return self._covariance(self.inverse, self._noise)

    def _covariance(self, inverse: Array, noise: Array) -> Array:
        wider = self.wider
        return np.asarray(inverse @ noise @ inverse * wider[:, None] * wider)

    def with_block(
        self, matrix: Array, vector: Array, widened: Array, bias: Array, excess: Array, z: Array, unit: Array
    ) -> tuple[Array, Array, float]:
        """Return estimate (k,) and covariance (k, k) with samples that are not added yet, and how far away it is.

        That is the largest distance from `z`, in units of a coordinate, that is longer than a standard deviation.

        Args:
            matrix, vector: what these samples say, shapes (k, k) and (k,).
            widened: from `Levels.wider`, shape (k, k).
            bias: that is taken off, and counts as uncertain, shape (k,).
            excess: what else is added to the covariance, shape (k, k).
            z, unit: parameters at which these samples passed the filter, and units of the coordinates, shapes (k,).
        """
        mean, covariance = np.empty_like(self.vector), np.empty_like(self.matrix)
        away = compile_shared().newest(
            self.matrix, self.vector, self._noise, matrix, vector, self.wider, widened, bias, self.doubt + excess,
            z, unit, mean, covariance,
        )  # fmt: skip
        return mean, covariance, away

    @property
    def inverse(self) -> Array:
        """Inverse of the information matrix, shape (k, k)."""
        return self._solve()[1]

    def _excess(self) -> Array:
        return np.maximum(1.0, (FIRM + self._scatter) / (FIRM + self._stretches))

    def add(self, piece: Piece, memory_s: float) -> None:
        """Add a block of samples, after forgetting a part of what is known."""
        precision = self.matrix @ solve(self._noise, self.matrix)
        bare = piece if piece.passed is None else replace(piece, passed=None)
        self._blocks.append(_Step(self.matrix, self.vector, self._noise, precision, precision @ self.mean, bare))
        kept = float(np.exp(-piece.duration / memory_s))
        widened = (1.0 - kept) * self._least
        mean = self.mean
        self._noise = kept * kept * self._noise + (1.0 - kept * kept) * self._least + piece.matrix
        self.matrix = kept * self.matrix + widened + piece.matrix
        self.vector = kept * self.vector + widened @ mean + piece.vector
        self._solved = None

    def shift(self, more: Array) -> None:
        """Add to the vector: the noise levels changed, and with them what the samples say."""
        self.vector = self.vector + more
        self._solved = None

    def allow(self, tails: Array | None) -> None:
        """Let the test allow for noise levels that are hardly known: see `Levels.tails` at `SELDOM`; None: they are."""
        if tails is not None:
            self.unsure = np.append(tails, tails.max()) ** 2

    def test(self) -> Change | None:
        """Test the newest blocks against the memory before them."""
        excess = self._excess() * self.unsure
        best: tuple[float, Change] | None = None
        doubt = Doubt(len(self.matrix))
        window: Stretch | None = None
        steps = list(self._blocks)
        for stretch in self._stretches_of(steps, excess):
            count = stretch.count
            if stretch.largest >= LEAST:  # hardly ever
                matrix = np.sum([step.block.matrix for step in steps[-count:]], axis=0)
                doubt.consider(steps[-count].precision, matrix, stretch.score, stretch.information, excess[:-1])
            if count not in LENGTHS:
                continue
            if count == WINDOW_BLOCKS:
                window = stretch
            if count <= LEARNED:
                learned = stretch
            rare = AGAIN if self._changed and self.whole and count == len(steps) else RARE
            if stretch.surely_none(excess, rare):  # nearly always
                continue
            found = changed_parameters(stretch.score, stretch.information, excess, rare, stretch.total)
            if found is not None and (best is None or found[2] > best[0]):
                names, likely, likelihood, size = found
                newest = steps[-learned.count :]
                wider = np.sqrt(excess[:-1])
                covariance = inverse_of(newest[0].precision) * np.outer(wider, wider)
                blocks = tuple(step.block for step in newest)
                best = likelihood, Change(names, likely, blocks, learned.mean, covariance, size)
        if best is not None:
            return best[1]
        self.doubt = doubt.covariance
        if window is not None:
            self._scatter_of(window)
        return None

    @staticmethod
    def _stretches_of(steps: Sequence[_Step], excess: Array) -> list[Stretch]:
        """Return what the newest blocks say of a change at the begin of each length of a stretch."""
        return stretches(
            [step.precision for step in steps], [step.weighted for step in steps],
            [step.block.matrix for step in steps], [step.block.vector for step in steps],
            [count for count in SCANNED if count <= len(steps)], excess,
        )  # fmt: skip

    def _scatter_of(self, stretch: Stretch) -> None:
        """Take the scatter of one stretch of `WINDOW_BLOCKS` blocks in `WINDOW_BLOCKS`."""
        self._since += 1
        if self._since < WINDOW_BLOCKS:
            return
        self._since = 0
        single = stretch.score**2 / np.maximum(np.diag(stretch.information), 1e-300)
        total, rank = stretch.chi2
        kept = np.exp(-1.0 / REMEMBERED)
        self._scatter = kept * self._scatter + np.append(single, total / max(rank, 1))
        self._stretches = kept * self._stretches + 1.0
        self.wider = np.sqrt(self._excess()[:-1])

    @property
    def blocks(self) -> list[Piece]:
        """The newest blocks, which can be passed through the filter again."""
        return [step.block for step in self._blocks]

    @property
    def newest(self) -> Piece | None:
        """The newest block; None before the first one."""
        return self._blocks[-1].block if self._blocks else None

    @property
    def whole(self) -> bool:
        """Whether these are all blocks since the begin."""
        return len(self._blocks) < HISTORY

    def weights(self, memory_s: float) -> list[float]:
        """Return for each of these blocks how much of it is not forgotten yet."""
        durations = np.array([step.block.duration for step in self._blocks])
        return np.exp(-(durations.sum() - durations.cumsum()) / memory_s).tolist()

    def before(self, memory_s: float) -> tuple[Array, Array]:
        """Return mean (k,) and precision (k, k) of what was known before these blocks and is not forgotten yet."""
        first = self._blocks[0]
        kept = float(np.exp(-sum(step.block.duration for step in self._blocks) / memory_s))
        widened = (1.0 - kept) * self._least
        matrix = kept * first.matrix + widened
        return solve(matrix, kept * first.vector + widened @ self.mean), matrix

    def replace(self, blocks: Sequence[Piece], memory_s: float) -> None:
        """Take other results of the newest blocks, from another pass of the filter."""
        self.drop(len(self._blocks))
        for block in blocks:
            self.add(block, memory_s)

    def copy(self) -> Memory:
        """Return a copy that can be changed without changing this one."""
        other = copy(self)
        other._blocks = self._blocks.copy()
        return other

    def drop(self, count: int) -> None:
        """Take back the newest blocks: the joint changed within them."""
        for _ in range(count):
            step = self._blocks.pop()
        self.matrix, self.vector, self._noise = step.matrix, step.vector, step.noise
        self._solved = None


def agree(estimate: Estimate, known: tuple[Array, Array], coordinates: Coordinates) -> bool:
    """Return whether an estimate from a window by itself agrees with mean (k,) and covariance (k, k) (Wald test)."""
    alone = Belief.after(estimate, coordinates)
    away = alone.mean - known[0]
    covariance = inverse_of(alone.precision) + known[1]
    scale = 1.0 / np.sqrt(np.diag(covariance))
    solved = np.linalg.solve(covariance * np.outer(scale, scale), away * scale)
    return float(away * scale @ solved) < float(chdtri(len(away), RARE))
