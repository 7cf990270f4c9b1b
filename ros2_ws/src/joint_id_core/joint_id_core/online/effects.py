"""What noise and smooth friction do to what a memory knows: levels that are estimates, and biases."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.friction_bias import FrictionBias
from joint_id_core.online.input_noise import InputNoise
from joint_id_core.online.levels import Levels
from joint_id_core.online.memory import SELDOM, Memory
from joint_id_core.online.piece import Piece
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.online.tracker import Tracker


class Effects:
    """Noise levels, and the biases of k parameters.

    Args:
        levels: noise levels, which follow the samples.
        spread: standard deviations of the prior, shape (k,).
        memory_s: time constant of forgetting.

    Attributes:
        levels: those of today.
        wider: what widens the covariance for the uncertainty of the levels, shape (k, k).
    """

    def __init__(self, levels: Levels, spread: Array, memory_s: float) -> None:
        self.wider = np.eye(len(spread))
        self.levels, self._memory_s = levels, memory_s
        self._input_noise, self._friction = (InputNoise(SummedEffect(spread)), FrictionBias(SummedEffect(spread)))

    def learn(self, tracker: Tracker, memory: Memory, new: Sequence[Piece], anew: bool) -> Array:
        """Learn from new blocks that the memory describes; return how the levels change its vector, shape (k,).

        With `anew`, the levels are learned from all blocks, if the memory has them all.
        """
        anew = anew and memory.whole
        self._input_noise.learn(tracker, new, self._memory_s)
        self._friction.learn(tracker, new, self._memory_s)
        return self.levels.learn(tracker, memory.blocks if anew else new, memory.mean, self._memory_s, anew)

    def changed(self, changed: Sequence[int], inverse: Array, still_known: Array) -> Effects:
        """Return what is still known of the effects when parameters changed: those on the others.

        `inverse` (k, k) is that of the information matrix before, `still_known` (k, k) the precision of what is still
        known.
        """
        of, other = (changed, inverse, still_known), copy(self)
        other.levels = self.levels.changed(*of)
        other._input_noise, other._friction = self._input_noise.changed(*of), self._friction.changed(*of)
        return other

    def apply(self, memory: Memory) -> None:
        """Take the levels of today into what is published of a memory, and into its test of changes."""
        self.wider = self.levels.wider(memory.inverse)
        memory.allow(self.levels.tails(SELDOM))

    def biases(self, memory: Memory) -> tuple[Array, Array]:
        """Return a bias (k,) that is taken off and counts as uncertain, and what else is added to the covariance."""
        inverse = memory.inverse
        return self._input_noise.bias(inverse), self._friction.excess(inverse)


@dataclass(frozen=True)
class EffectsBefore:
    """Effects as they were before a change, with the inverse (k, k) of the information matrix then."""

    effects: Effects
    inverse: Array

    def changed(self, changed: Sequence[int], still_known: Array) -> Effects:
        """Return what is still known of them: see `Effects.changed`."""
        return self.effects.changed(changed, self.inverse, still_known)
