"""Which parameters changed: the score test of a stretch of samples against what was known before it.

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chdtri

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array

LEFT = 0.05  # probability from which what is left after the changes of some parameters counts as noise
ALIKE = 9.0  # difference of the likelihood ratio up to which two explanations are both possible
SAME = 1e-9  # relative difference of two likelihood ratios that rounding can make: the first parameter is taken
RANK = 1e-10  # smallest eigenvalue of M, scaled to a unit diagonal, that counts as information


def score_of(precision: Array, weighted: Array, matrix: Array, vector: Array) -> tuple[Array, Array, Array]:
    """Return score (k,) and information (k, k) of a change, and the mean before it (k,).

    `precision` (k, k), and `weighted` (k,), that times the mean, are the memory before a stretch; `matrix` and `vector`
    are what the stretch says.
    """
    score, information, mean = np.empty_like(vector), np.empty_like(matrix), np.empty_like(vector)
    compile_shared().change(precision, weighted, matrix, vector, score, information, mean)
    return score, information, mean


@lru_cache(maxsize=256)
def limit(freedom: int, rare: float) -> float:
    """Return what a chi-squared number exceeds with this probability."""
    return float(chdtri(freedom, rare))


@dataclass(frozen=True)
class Stretch:
    """The newest `count` blocks, and what they say of a change at their begin.

    Attributes:
        count: number of blocks.
        score, information, mean: as from `score_of`.
        total: v' M^-1 v; NaN where M may not have full rank.
        largest: squared score of one parameter over its variance and excess.
    """

    count: int
    score: Array
    information: Array
    mean: Array
    total: float
    largest: float

    @property
    def chi2(self) -> tuple[float, int]:
        """v' M^-1 v and the rank of M."""
        return chi2(self.score, self.information) if np.isnan(self.total) else (self.total, len(self.score))

    def surely_none(self, excess: Array, rare: float) -> bool:
        """Return whether `changed_parameters` finds no change, without doubt."""
        k = len(self.score)
        return self.total / excess[-1] < limit(k, rare) and self.largest < limit(1, rare / k)


def stretches(
    precision: Sequence[Array],
    weighted: Sequence[Array],
    matrices: Sequence[Array],
    vectors: Sequence[Array],
    lengths: Sequence[int],
    excess: Array,
) -> list[Stretch]:
    """Return stretches of the newest blocks, of rising `lengths`.

    For each block, `precision` (k, k) and `weighted` (k,) are the memory before it, `matrices` (k, k) and `vectors`
    (k,) what it says. The last element of `excess` is that of all parameters together.
    """
    n, k, count = len(matrices), len(excess) - 1, len(lengths)
    score, mean, information = np.empty((count, k)), np.empty((count, k)), np.empty((count, k, k))
    total, largest = np.empty(count), np.empty(count)
    compile_shared().scan(
        np.concatenate(precision).reshape(n, k, k), np.concatenate(weighted).reshape(n, k),
        np.concatenate(matrices).reshape(n, k, k), np.concatenate(vectors).reshape(n, k),
        np.array(lengths), excess[:-1], score, information, mean, total, largest,
    )  # fmt: skip
    rows = zip(lengths, score, information, mean, total.tolist(), largest.tolist(), strict=True)
    return [Stretch(*row) for row in rows]


def chi2(score: Array, information: Array) -> tuple[float, int]:
    """Return v' M^-1 v and the rank of M.

    Where the path of the filter nearly diverges, M is no information: a parameter whose diagonal is not positive tells
    nothing then. inf if nothing is left that is finite.
    """
    diagonal = np.diag(information)
    if not (np.isfinite(information).all() and np.isfinite(score).all()):
        return np.inf, len(score)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.maximum(diagonal, 1e-300)), 0.0)
    size, axes = np.linalg.eigh(information * np.outer(scale, scale))
    seen = size > RANK * len(size)
    return float(np.sum((axes[:, seen].T @ (scale * score)) ** 2 / size[seen])), int(np.count_nonzero(seen))


def changed_parameters(
    score: Array, information: Array, excess: Array, rare: float, total: float = np.nan
) -> tuple[tuple[int, ...], tuple[int, ...], float, float] | None:
    """Return the parameters that changed, those that may have, the likelihood ratio and the size; None if none changed.

    Parameters are added until what is left looks like noise (forward selection). `total` is v' M^-1 v where M is known
    to have full rank.
    """
    rank = len(score)
    if np.isnan(total):
        total, rank = chi2(score, information)
    if not rank:
        return None
    if np.isinf(total):  # the path of the filter diverged: any may have changed
        return tuple(range(len(score))), (), np.inf, np.inf
    total /= excess[-1]
    single = score**2 / np.maximum(np.diag(information), 1e-300) / excess[:-1]
    if total < limit(rank, rare) and float(single.max()) < limit(1, rare / len(score)):
        return None
    names: list[int] = []
    explained = 0.0
    while len(names) < rank:  # at most as many as the samples can tell apart
        rest = [j for j in range(len(score)) if j not in names]
        each = [chi2(score[[*names, j]], information[np.ix_([*names, j], [*names, j])])[0] for j in rest]
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
            if chi2(score[others], information[np.ix_(others, others)])[0] > explained - ALIKE:
                found.append(j)
                break
    return found
