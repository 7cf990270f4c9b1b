"""A stretch of measured or simulated motion of one joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from joint_id_core.arguments import require_type
from joint_id_core.data.load_errors import LoadErrors
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError

Array = NDArray[np.float64]  # of any shape; docstrings say which


def any_finite(values: Array) -> bool:
    """Return whether any of the values, shape (T,), is finite; fast, since the first one usually is."""
    return bool(len(values) and math.isfinite(values[0])) or bool(np.isfinite(values).any())


def _floats(values: ArrayLike, what: str) -> Array:
    """Return a copy of values as floats, NaN where they are masked.

    It is a copy, since arrays of pandas are read-only and compiled functions do not take those.

    Raises:
        JointIdError: dates, complex numbers, text, or lists of different lengths.
    """
    try:
        given: NDArray[Any] = np.ma.asarray(values)
        if given.dtype.kind in "cmM":
            raise TypeError
        return np.array(np.ma.filled(given.astype(float), np.nan))
    except (TypeError, ValueError):
        raise JointIdError(f"{what} is not an array of numbers: give floats, time in s") from None


@dataclass(frozen=True)
class Recording:
    """Samples of one joint.

    Attributes:
        time: instants in s, shape (T,), strictly increasing; steps may differ, and there may be gaps.
        channels: values by channel name (`joint_id_core.data.signals.CHANNELS`), each of shape (T,), SI units,
            NaN where nothing was measured.
        derived: names of channels that were computed by a filter and not measured. They serve as start
            values and inputs, never as labels.
        source: where the samples came from (a file, a topic), for messages.
        joint: name of the joint.
        origin: zero of `time` in whole seconds on the clock of the source. Seconds since 1970 as doubles have a
            resolution of 0.24 us; in that time a motor turns by more than the noise of its encoder.
        load_errors: what an external torque that was computed may be off by; None if that is not told.

    Raises:
        JointIdError: unknown channel, wrong shape, infinite values, time that is not strictly increasing.
    """

    time: Array
    channels: Mapping[str, Array]
    derived: frozenset[str] = frozenset()
    source: str = "recording"
    joint: str = ""
    origin: int = 0
    load_errors: LoadErrors | None = None

    def __post_init__(self) -> None:
        require_type("source", self.source, str, "give a text")
        require_type("joint", self.joint, str, "give the name of a joint")
        time = _floats(self.time, f"{self.source}: time")
        if time.ndim != 1:
            raise JointIdError(f"{self.source}: time must be one-dimensional, not of shape {time.shape}")
        if not (finite := np.isfinite(time)).all():
            k = int(np.argmin(finite))
            raise JointIdError(f"{self.source}: time of sample {k} is {time[k]}: remove such samples")
        steps = time[1:] - time[:-1]
        if (back := steps <= 0.0).any():
            k = int(np.argmax(back))
            where = f"at sample {k + 1} ({time[k]:.9g} s, then {time[k + 1]:.9g} s)"
            if (steps >= 0.0).all():
                often = f", {np.count_nonzero(back)} times in all" if np.count_nonzero(back) > 1 else ""
                raise JointIdError(
                    f"{self.source}: time repeats {where}{often}: keep one sample of each time, or give times with "
                    "more digits"
                )
            what = "repeats" if steps[k] == 0 else "goes backwards"
            raise JointIdError(f"{self.source}: time {what} {where}: sort the samples, or cut the file there")
        channels = {}
        if not hasattr(self.channels, "items"):  # a frame of pandas has it, too
            raise JointIdError(
                f"{self.source}: channels are of type {type(self.channels).__name__}: give a dictionary, such as "
                '{"torque": values}'
            )
        for name, values in self.channels.items():
            if name not in CHANNELS:
                raise JointIdError(f"{self.source}: unknown channel {name!r}: known are {', '.join(CHANNELS)}")
            values = _floats(values, f"{self.source}: {name}")
            if values.shape != time.shape:
                raise JointIdError(f"{self.source}: {name} has shape {values.shape}, time has {time.shape}")
            if (infinite := np.isinf(values)).any():
                k = int(np.argmax(infinite))
                raise JointIdError(
                    f"{self.source}: {name} is infinite at sample {k} ({time[k]:.9g} s): write NaN, or in a table "
                    "nothing, for a value that was not measured"
                )
            channels[name] = values
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "channels", channels)

    def __len__(self) -> int:
        return len(self.time)

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def __getitem__(self, name: str) -> Array:
        """Return the values of a channel, shape (T,).

        Raises:
            JointIdError: the recording does not have the channel.
        """
        if name not in self.channels:
            raise JointIdError(f"{self.source} has no {name}: it has {', '.join(self.channels) or 'no channel'}")
        return self.channels[name]

    @cached_property
    def _steps(self) -> Array:
        """Steps between the instants in s, shape (T - 1,)."""
        return self.time[1:] - self.time[:-1]

    @property
    def duration(self) -> float:
        """Time between the first and the last sample in s."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    @property
    def period(self) -> float:
        """Median time step in s (NaN for fewer than two samples)."""
        return float(np.median(self._steps)) if len(self) > 1 else float("nan")

    @property
    def gaps(self) -> int:
        """Number of steps longer than 1.5 periods."""
        return int(np.count_nonzero(self._steps > 1.5 * self.period)) if len(self) > 1 else 0

    def measured(self, name: str) -> bool:
        """Return whether the channel holds measurements (present, not derived, not all NaN)."""
        return name in self.channels and name not in self.derived and any_finite(self.channels[name])

    def mean(self, name: str) -> float:
        """Return the mean of the values of a channel; NaN if there are none."""
        known = self.channels[name][np.isfinite(self.channels[name])] if name in self else np.zeros(0)
        return float(known.mean()) if len(known) else math.nan

    def window(self, start: float, end: float) -> Recording:
        """Return the samples with start <= time < end, in s as in `time`."""
        i, j = np.searchsorted(self.time, [start, end])
        return self.slice(int(i), int(j))

    def slice(self, i: int, j: int) -> Recording:
        """Return the samples i to j (exclusive)."""
        return self.trusted(self.time[i:j], {n: v[i:j] for n, v in self.channels.items()}, self.derived)

    def trusted(
        self, time: Array, channels: Mapping[str, Array], derived: frozenset[str], joint: str | None = None
    ) -> Recording:
        """Build a recording of the same source from samples that were already checked, without a new check.

        It is of the same joint, unless another one is given.
        """
        made = object.__new__(Recording)
        made.__dict__.update(
            time=time, channels=channels, derived=derived, source=self.source,
            joint=self.joint if joint is None else joint, origin=self.origin, load_errors=self.load_errors,
        )  # fmt: skip
        return made

    def with_channels(self, changes: Mapping[str, Array], derived: bool = False) -> Recording:
        """Return a copy with channels added or replaced, marked as `derived` or as measured."""
        names = frozenset(changes)
        marks = self.derived | names if derived else self.derived - names
        return replace(self, channels={**self.channels, **changes}, derived=marks)

    def with_load_errors(self, errors: LoadErrors | None) -> Recording:
        """Return a copy with what its computed external torque may be off by; None: that is not told."""
        made = self.trusted(self.time, self.channels, self.derived)
        made.__dict__["load_errors"] = errors
        return made
