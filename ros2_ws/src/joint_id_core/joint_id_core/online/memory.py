"""What the samples so far say about the parameters, and the test of new samples against it.

Information adds up: each stretch of samples contributes an information matrix H and a vector h in estimation
coordinates, and the estimate solves (sum H) z = sum h. Older information is forgotten exponentially.

New samples are tested against what the memory predicts, with the noise levels that it knows. Let z be the estimate
before a stretch, P its covariance, and (H, h) the stretch. P is that of an exponentially weighted mean: with the sum L
of information and the covariance B of the sum of the vectors, P^-1 = L B^-1 L. If nothing changed, the score
v = P^-1 (P^-1 + H)^-1 (h - H z) is normal with the covariance M = P^-1 (P^-1 + H)^-1 H: v' M^-1 v is chi-squared, and
t_j = v_j / sqrt(M_jj) is standard normal. Where earlier stretches scattered more than that, v' M^-1 v and t_j^2 are
divided by this excess. Both are tested: this is the score test of a change of the parameters (Rao 1948), for several
lengths of the stretch at once, as in the generalised likelihood ratio test (Basseville & Nikiforov, Detection of Abrupt
Changes, 1993, ch. 7).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.online.piece import Piece
from joint_id_core.results.estimate import Estimate

LENGTHS = (1, 2, 4, 8, 16, 32)  # blocks of the stretches that are tested
HISTORY = 128  # blocks that can be passed through the filter again, where little is known yet
RARE = 1e-7  # probability of one test to find a change where there is none
AGAIN = 1e-4  # the same for all stretches since a change: where one parameter changed, others often did
LEFT = 0.05  # probability from which what is left after the changes of some parameters counts as noise
ALIKE = 9.0  # difference of the likelihood ratio up to which two explanations are both possible
SAME = 1e-9  # relative difference of two likelihood ratios that rounding can make: the first parameter is taken
RANK = 1e-10  # smallest eigenvalue of M, scaled to a unit diagonal, that counts as information
WINDOW_BLOCKS = 4  # blocks of a stretch for the scatter
FIRM = 8.0  # stretches without scatter that are assumed before the first one
REMEMBERED = 60.0  # stretches after which the scatter of an older one is forgotten


@dataclass(frozen=True)
class Change:
    """A change of parameters that the samples show.

    Attributes:
        names: parameters that changed, the most significant first, as indices of the free parameters.
        likely: further parameters that may have changed.
        blocks: the newest blocks; the change happened in the first of them.
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
        return self.mean, _inverse(self.covariance + np.diag(wide**2))


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
    """Information on the free parameters of one joint."""

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

    @property
    def mean(self) -> Array:
        """Present estimate, shape (k,)."""
        return _solve(self.matrix, self.vector)

    @property
    def covariance(self) -> Array:
        """Covariance of the estimate, shape (k, k), widened by the scatter of stretches that share no sample."""
        return self.covariance_with(np.zeros_like(self.matrix))

    def covariance_with(self, more: Array) -> Array:
        """Return the covariance with the information matrix `more` of samples that are not yet added."""
        inverse, wider = _inverse(self.matrix + more), self.wider
        return np.asarray(inverse @ (self._noise + more) @ inverse * np.outer(wider, wider))

    @property
    def inverse(self) -> Array:
        """Inverse of the information matrix, shape (k, k)."""
        return _inverse(self.matrix)

    @property
    def wider(self) -> Array:
        """Factor on the standard deviation of each parameter that its scatter asks for, at least 1, shape (k,)."""
        return np.sqrt(self._excess()[:-1])

    def _excess(self) -> Array:
        return np.maximum(1.0, (FIRM + self._scatter) / (FIRM + self._stretches))

    def add(self, piece: Piece, memory_s: float) -> None:
        """Add a block of samples, after forgetting a part of what is known."""
        precision = self.matrix @ _solve(self._noise, self.matrix)
        self._blocks.append(_Step(self.matrix, self.vector, self._noise, precision, precision @ self.mean, piece))
        kept = float(np.exp(-piece.duration / memory_s))
        widened = (1.0 - kept) * self._least
        mean = self.mean
        self._noise = kept * kept * self._noise + (1.0 - kept * kept) * self._least + piece.matrix
        self.matrix = kept * self.matrix + widened + piece.matrix
        self.vector = kept * self.vector + widened @ mean + piece.vector

    def test(self) -> Change | None:
        """Test the newest blocks against the memory before them."""
        excess = self._excess()
        best: tuple[float, Change] | None = None
        window: tuple[Array, Array] | None = None
        matrix, vector = np.zeros_like(self.matrix), np.zeros_like(self.vector)
        for count, step in enumerate(reversed(self._blocks), start=1):
            if count > LENGTHS[-1]:
                break
            matrix, vector = matrix + step.block.matrix, vector + step.block.vector
            if count not in LENGTHS:
                continue
            score, information, mean = _score(step.precision, step.weighted, matrix, vector)
            if count == WINDOW_BLOCKS:
                window = score, information
            since_change = self._changed and count == len(self._blocks)
            found = _changed(score, information, excess, AGAIN if since_change else RARE)
            if found is not None and (best is None or found[2] > best[0]):
                names, likely, likelihood, size = found
                newest = tuple(s.block for s in list(self._blocks)[-count:])
                covariance = _inverse(step.precision) * np.outer(np.sqrt(excess[:-1]), np.sqrt(excess[:-1]))
                best = likelihood, Change(names, likely, newest, mean, covariance, size)
        if best is not None:
            return best[1]
        if window is not None:
            self._scatter_of(*window)
        return None

    def _scatter_of(self, score: Array, information: Array) -> None:
        """Take the scatter of one stretch of `WINDOW_BLOCKS` blocks in `WINDOW_BLOCKS`."""
        self._since += 1
        if self._since < WINDOW_BLOCKS:
            return
        self._since = 0
        single = score**2 / np.maximum(np.diag(information), 1e-300)
        total, rank = _chi2(score, information)
        kept = np.exp(-1.0 / REMEMBERED)
        self._scatter = kept * self._scatter + np.append(single, total / max(rank, 1))
        self._stretches = kept * self._stretches + 1.0

    @property
    def blocks(self) -> list[Piece]:
        """The newest blocks, which can be passed through the filter again."""
        return [step.block for step in self._blocks]

    def weights(self, memory_s: float) -> list[float]:
        """Return for each of these blocks how much of it is not forgotten yet."""
        durations = np.array([step.block.duration for step in self._blocks])
        return np.exp(-(durations.sum() - durations.cumsum()) / memory_s).tolist()

    def before(self) -> tuple[Array, Array]:
        """Return mean (k,) and precision (k, k) of what was known before these blocks."""
        first = self._blocks[0]
        return _solve(first.matrix, first.vector), first.precision

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


def agree(estimate: Estimate, memory: Memory, coordinates: Coordinates) -> bool:
    """Return whether an estimate from a window by itself agrees with the memory (Wald test)."""
    alone = Belief.after(estimate, coordinates)
    away = alone.mean - memory.mean
    covariance = _inverse(alone.precision) + memory.covariance
    scale = 1.0 / np.sqrt(np.diag(covariance))
    solved = np.linalg.solve(covariance * np.outer(scale, scale), away * scale)
    return float(away * scale @ solved) < float(chdtri(len(away), RARE))


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a symmetric positive definite system after scaling it to a unit diagonal."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    solved = np.linalg.solve(matrix * np.outer(scale, scale), (right.T * scale).T)
    return np.asarray((solved.T * scale).T)


def _inverse(matrix: Array) -> Array:
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.asarray(np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale))


def _score(precision: Array, weighted: Array, matrix: Array, vector: Array) -> tuple[Array, Array, Array]:
    """Return score (k,) and information (k, k) of a change, and the mean before it (k,).

    `precision` (k, k), and `weighted` (k,), that times the mean, are the memory before a stretch; `matrix` and `vector`
    are what the stretch says.
    """
    mean = _solve(precision, weighted)
    r = vector - matrix @ mean
    solved = _solve(precision + matrix, np.column_stack([r, matrix]))
    found = precision @ solved
    information = found[:, 1:]
    return found[:, 0], 0.5 * (information + information.T), mean


def _chi2(score: Array, information: Array) -> tuple[float, int]:
    """Return v' M^-1 v and the rank of M."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    size, axes = np.linalg.eigh(information * np.outer(scale, scale))
    seen = size > RANK * len(size)
    return float(np.sum((axes[:, seen].T @ (scale * score)) ** 2 / size[seen])), int(np.count_nonzero(seen))


def _changed(
    score: Array, information: Array, excess: Array, rare: float
) -> tuple[tuple[int, ...], tuple[int, ...], float, float] | None:
    """Return the parameters that changed, those that may have, the likelihood ratio and the size; None if none changed.

    Parameters are added until what is left looks like noise (forward selection).
    """
    total, rank = _chi2(score, information)
    if not rank:
        return None
    total /= excess[-1]
    single = score**2 / np.maximum(np.diag(information), 1e-300) / excess[:-1]
    if total < chdtri(rank, rare) and float(single.max()) < chdtri(1, rare / len(score)):
        return None
    names: list[int] = []
    explained = 0.0
    while len(names) < rank:  # at most as many as the samples can tell apart
        rest = [j for j in range(len(score)) if j not in names]
        each = [_chi2(score[[*names, j]], information[np.ix_([*names, j], [*names, j])])[0] for j in rest]
        best = int(np.argmax(np.array(each) >= (1.0 - SAME) * max(each)))
        names.append(rest[best])
        explained = each[best] / excess[-1]
        if total - explained < chdtri(max(1, rank - len(names)), LEFT):
            break
    likely = _alternatives(score, information, names, explained * excess[-1])
    return tuple(names), tuple(likely), total - rank, float(np.sqrt(single[names[0]]))


def _alternatives(score: Array, information: Array, names: list[int], explained: float) -> list[int]:
    """Return further parameters whose change explains nearly as much in place of one of `names`."""
    found = []
    for j in set(range(len(score))).difference(names):
        for i in range(len(names)):
            others = [*names[:i], *names[i + 1 :], j]
            if _chi2(score[others], information[np.ix_(others, others)])[0] > explained - ALIKE:
                found.append(j)
                break
    return found
