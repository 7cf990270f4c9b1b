"""What a check of a recording found."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Recording

SAMPLES = "samples"  # what a finding about single samples is about: they look like a motion that is faster than any
MOST_SHOWN = 3  # samples that a text names
REMOVE = "remove these values (an empty cell is a missing value)"


@dataclass(frozen=True)
class Finding:
    """A doubt about a recording.

    Attributes:
        text: one sentence: what is wrong, where, and what to do.
        channels: which channels it is about; none means all.
        fatal: whether a fit of these channels would be wrong in any case.
        about: kind of doubt, where others ask for it.
        samples: numbers of the single samples that it is about.
    """

    text: str
    channels: tuple[str, ...] = ()
    fatal: bool = False
    about: str = ""
    samples: tuple[int, ...] = ()

    def concerns(self, names: Collection[str]) -> bool:
        """Return whether it is about one of these channels."""
        return not self.channels or any(n in names for n in self.channels)


def places(recording: Recording, samples: NDArray[np.int64]) -> str:
    """Return samples (k,) in words, with their times: the first ones, and how many more there are."""
    shown = ", ".join(f"{k} ({recording.time[k]:.6g} s)" for k in samples[:MOST_SHOWN].tolist())
    more = len(samples) - MOST_SHOWN
    return f"sample{'s' if len(samples) > 1 else ''} {shown}" + (f" and {more} more" if more > 0 else "")


def stretches(recording: Recording, ends: Sequence[tuple[int, int]]) -> str:
    """Return stretches between two samples in words, with their times."""
    time = recording.time
    shown = ", ".join(f"{a} to {b} ({time[a]:.6g} to {time[b]:.6g} s)" for a, b in ends[:MOST_SHOWN])
    more = len(ends) - MOST_SHOWN
    return shown + (f" and {more} more" if more > 0 else "")


def number(count: int, one: str, many: str = "") -> str:
    """Return a count in words: "1 stretch", "2 stretches"."""
    return f"{count} {one if count == 1 else many or one + 's'}"
