"""A stretch of samples of one joint, and what it says about the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array


@dataclass(frozen=True)
class Samples:
    """Samples of one joint: instants (T,) in s, inputs (T, inputs), labels (T, labels), NaN where missing."""

    time: Array
    u: Array
    y: Array


def joined(samples: Sequence[Samples]) -> Samples:
    """Return consecutive samples as one stretch."""
    return Samples(*(np.concatenate([getattr(s, name) for s in samples]) for name in ("time", "u", "y")))


@dataclass(frozen=True)
class State:
    """State of the filter: see `loops.tracking`.

    Attributes:
        kept: the state with its covariance and its derivatives by the parameters, and the state one sample before.
        time, u: of the last sample; u has shape (inputs,).
        start: state of the prior, and the first samples, that gave this one; None if the start was longer ago.
    """

    kept: Array
    time: float
    u: Array
    start: tuple[State, Samples] | None = None


@dataclass(frozen=True)
class Passed:
    """Outputs of `loops.tracking.track`, whose first row is the sample before, and its labels."""

    cost: float
    kept: Array
    y: Array
    errors: Array
    variances: Array
    gains: Array
    slopes: Array
    shown: Array
    sensitivities: Array
    matrix: Array
    score: Array

    @classmethod
    def joined(cls, parts: Sequence[Passed]) -> Passed:
        """Return the outputs of passes, of which each begins where the one before ended, as those of one pass."""
        last = parts[-1]
        rows = {
            name: np.concatenate([getattr(parts[0], name), *(getattr(part, name)[1:] for part in parts[1:])])
            for name in ("y", "errors", "variances", "gains", "shown", "sensitivities")
        }
        slopes = [*(part.slopes[:-1] for part in parts[:-1]), last.slopes]  # each is that to the next sample
        matrix, score = (np.sum([getattr(part, name) for part in parts], axis=0) for name in ("matrix", "score"))
        cost = sum(part.cost for part in parts)
        return cls(cost=cost, kept=last.kept, slopes=np.concatenate(slopes), matrix=matrix, score=score, **rows)


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
        largest: innovation, in standard deviations.
        passed: what the filter stored for `noise_information`; only the newest block needs it.
    """

    matrix: Array
    vector: Array
    white: Array
    begin: State
    samples: Samples
    z: Array
    smoothing: float
    largest: float = 0.0
    passed: Passed | None = None

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.samples.time[-1] - self.begin.time) if len(self.samples.time) else 0.0


class Block:
    """Consecutive pieces of the same reference that grow to a block of the memory.

    Attributes:
        pieces: in their order.
        matrix, vector: their sums, shapes (k, k) and (k,).
        duration: of all in s.
    """

    def __init__(self, parameters: int, pieces: Sequence[Piece] = ()) -> None:
        """Begin with some pieces, of this number of free parameters."""
        self.pieces: list[Piece] = []
        self.matrix, self.vector = np.zeros((parameters, parameters)), np.zeros(parameters)
        self.duration = 0.0
        for piece in pieces:
            self.add(piece)

    def add(self, piece: Piece) -> None:
        """Add the next piece."""
        self.pieces.append(piece)
        self.matrix += piece.matrix
        self.vector += piece.vector
        self.duration += piece.duration


def merged(pieces: Sequence[Piece]) -> Piece:
    """Return consecutive pieces of the same reference as one."""
    if len(pieces) == 1:
        return pieces[0]
    passed = [piece.passed for piece in pieces if piece.passed is not None]
    return Piece(
        np.sum([piece.matrix for piece in pieces], axis=0),
        np.sum([piece.vector for piece in pieces], axis=0),
        np.concatenate([piece.white for piece in pieces]),
        pieces[0].begin,
        joined([piece.samples for piece in pieces]),
        pieces[0].z,
        max(piece.smoothing for piece in pieces),
        max(piece.largest for piece in pieces),
        Passed.joined(passed) if len(passed) == len(pieces) else None,
    )
