"""How the simulated joints move: references of a position controller, and voltages."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.simulation.excitation import STEP_S, STEPS_V, position_reference
from joint_id_core.simulation.minimum_jerk import minimum_jerk
from joint_id_core.simulation.position_control import Reference

LONGEST_S = 4000.0
FARTHEST, SLOWEST, FASTEST = 1.0, 0.4, 1.0  # rad; rad/s, mean speed of a move
SHORTEST_S, REST_S = 0.4, (0.1, 0.8)  # s
VOLTS = 8.0  # V for a reference speed of 1 rad/s


@dataclass(frozen=True)
class PointToPoint:
    """Moves of least jerk to random positions in rad, with rests: what a robot does all day."""

    seed: int
    _begins: Array = field(init=False, repr=False, compare=False)
    _moves: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        rng, t, at, moves = np.random.default_rng(self.seed), 0.3, 0.0, []
        while t < LONGEST_S:
            to = rng.uniform(-FARTHEST, FARTHEST)
            length = max(SHORTEST_S, abs(to - at) / rng.uniform(SLOWEST, FASTEST))
            moves.append((t, length, at, to))
            t, at = t + length + rng.uniform(*REST_S), to
        object.__setattr__(self, "_moves", np.array(moves))
        object.__setattr__(self, "_begins", self._moves[:, 0].copy())

    def value(self, time: float) -> float:
        """Position in rad at a time in s."""
        x, _, at, to = self._place(time)
        return at + (to - at) * minimum_jerk(x)[0]

    def rate(self, time: float) -> float:
        """Velocity in rad/s at a time in s."""
        x, length, at, to = self._place(time)
        return (to - at) / length * minimum_jerk(x)[1]

    def _place(self, time: float) -> tuple[float, float, float, float]:
        """How much of a move is done, its length in s, begin and end in rad."""
        begin, length, at, to = self._moves[max(0, int(np.searchsorted(self._begins, time, "right")) - 1)].tolist()
        return min(1.0, max(0.0, (time - begin) / length)), length, at, to


def reference(motion: str, seed: int) -> Reference:
    """The reference of a position controller; the excited one is a multisine."""
    return position_reference() if motion == "excited" else PointToPoint(seed)


@dataclass(frozen=True)
class Voltage:
    """The voltage of a motor that no controller drives: steps, or pulses with rests."""

    motion: str
    moves: PointToPoint

    def __call__(self, time: float) -> float:
        """V at a time in s."""
        if self.motion == "excited":
            return STEPS_V[int(time / STEP_S + 1e-6) % len(STEPS_V)]
        return VOLTS * self.moves.rate(time)
