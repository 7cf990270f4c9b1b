"""Output of one client: its recipe, its rate, and faults in the next samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from joint_id_core.rtde import packets
from joint_id_core.rtde.packets import Recipe, Value, encode

MOST_HZ, MOST_HZ_CB3 = 500.0, 125.0  # controllers before version 5 send at most the latter


@dataclass
class Output:
    """A recipe of outputs, its rate, and for each fault the number of next samples that will have it."""

    recipe: Recipe
    every: int  # ticks
    drop: int = 0
    zero: int = 0
    nan: int = 0

    def packet(self, values: Mapping[str, Value | Sequence[float]]) -> bytes:
        """Return the next data packet; b"" if it is dropped."""
        payload = self.recipe.pack(values)
        if self.zero:
            self.zero -= 1
            payload = bytes([self.recipe.number]) + bytes(len(payload) - 1)
        elif self.nan:
            self.nan -= 1
            payload = self.recipe.pack({**values, "actual_q": (math.nan,) * 6})
        if self.drop:
            self.drop -= 1
            return b""
        return encode(packets.DATA, payload)


def ticks_between(asked: float, version: tuple[int, ...]) -> int:
    """Return the ticks between samples for a requested rate in Hz: the largest rate divided by a whole number."""
    largest = MOST_HZ if version[0] >= 5 else MOST_HZ_CB3
    return round(MOST_HZ / largest) * max(1, math.floor(largest / asked + 1e-9))
