"""An effect on the score of the parameters, summed over stretches of samples, and what it does to the estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from joint_id_core.data.recording import Array


class SummedEffect:
    """An effect on the score of k parameters: a sum over stretches, which is forgotten as the memory forgets.

    Args:
        spread: standard deviations of the prior, shape (k,): what moves a parameter farther is no such effect, there
            the model does not describe the data.

    Attributes:
        seen: stretches since the begin, or since parameters changed.
    """

    def __init__(self, spread: Array) -> None:
        self.seen = 0
        self._spread, self._score = spread, np.zeros_like(spread)
        self._squares = np.zeros((len(spread), len(spread)))  # the sum of those of the effects
        self._found: tuple[Array, Array, Array] | None = None  # what `once` returned, of which inverse and score

    def add(self, effect: Array | None, duration: float, memory_s: float) -> None:
        """Add the effect (k,) of a stretch of `duration` (s); None if others stand for it."""
        kept = float(np.exp(-duration / memory_s))
        self._score, self._squares = kept * self._score, kept * kept * self._squares
        if effect is not None:
            self._score, self._squares = self._score + effect, self._squares + np.outer(effect, effect)
        self.seen += 1

    def moves(self, inverse: Array) -> tuple[Array, Array]:
        """Return by how much the parameters are moved, and the variance of its scatter, shapes (k,).

        `inverse` (k, k) is that of the information matrix of the memory.
        """
        scatter = np.einsum("ij,jk,ik->i", inverse, self._squares, inverse)
        return self.bounded(inverse @ self._score), scatter

    def bounded(self, moved: Array) -> Array:
        """Return a move of the parameters (k,) within their spreads."""
        return np.minimum(np.maximum(moved, -self._spread), self._spread)

    def once(self, inverse: Array, compute: Callable[[Array], Array]) -> Array:
        """Return what is computed of an inverse, anew only if that or the effect is another one than before."""
        found = self._found
        if found is None or found[1] is not inverse or found[2] is not self._score:
            found = self._found = compute(inverse), inverse, self._score
        return found[0]

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> SummedEffect:
        """Return the effect on what is still known when parameters changed.

        `inverse` (k, k) is that of the information matrix before, `precision` (k, k) that of what is still known.
        """
        moved, root = self.moves(inverse)[0], inverse.copy()
        moved[list(changed)], root[list(changed)] = 0.0, 0.0
        back, other = precision @ root, copy(self)
        other.seen, other._score, other._squares = 0, precision @ moved, back @ self._squares @ back.T
        return other
