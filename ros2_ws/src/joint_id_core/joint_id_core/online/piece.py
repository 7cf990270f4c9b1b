"""A stretch of samples of one joint, and what it says about the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Array

if TYPE_CHECKING:
    from joint_id_core.online.block import Block


@dataclass(frozen=True)
class Samples:
    """Samples of one joint: instants (T,) in s, inputs (T, inputs), labels (T, labels), NaN where missing."""

    time: Array
    u: Array
    y: Array

    def split(self, at: int) -> tuple[Samples, Samples]:
        """Return the samples before one, and those from it on."""
        first, then = (Samples(self.time[k], self.u[k], self.y[k]) for k in (slice(at), slice(at, None)))
        return first, then


def joined(samples: Sequence[Samples]) -> Samples:
    """Return consecutive samples as one stretch."""
    return Samples(*(np.concatenate([getattr(s, name) for s in samples]) for name in ("time", "u", "y")))


@dataclass(frozen=True)
class State:
    """State of the filter: see `loops.tracking`.

    Attributes:
        kept: the state with its covariance and its derivatives by the parameters.
        time, u: of the last sample; u has shape (inputs,).
        start: state of the prior, and the first samples, that gave this one; None if the start was longer ago.
    """

    kept: Array
    time: float
    u: Array
    start: tuple[State, Samples] | None = None


@dataclass(frozen=True)
class Piece:
    """What a stretch of samples says about the free parameters, in estimation coordinates z.

    Attributes:
        matrix, vector: information matrix H (k, k) and vector h (k,): the stretch alone says H z = h.
        white: innovations over their standard deviations, shape (T, labels), NaN where a label is missing.
        begin: state of the filter before the stretch.
        samples: the samples.
        z: parameters at which the filter ran, shape (k,).
        smoothing: of its friction, relative to that of a fit.
        levels: noise variances of its labels and inputs, shape (L,).
        largest: innovation, in standard deviations.
        passed: the pass of the filter with what it stored for `noise_information`; only the newest block needs it.
    """

    matrix: Array
    vector: Array
    white: Array
    begin: State
    samples: Samples
    z: Array
    smoothing: float
    levels: Array
    largest: float = 0.0
    passed: Block | None = None

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.samples.time[-1] - self.begin.time) if len(self.samples.time) else 0.0
