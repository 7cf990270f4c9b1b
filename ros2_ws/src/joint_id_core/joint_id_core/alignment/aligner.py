"""Align raw topics: build samples of all joints at one instant and add velocities and accelerations."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.alignment.joining import BACK_NS, Joiner, is_new_run
from joint_id_core.data.instants import NANO, instant, seconds
from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import FilteredSample, StreamingFilter
from joint_id_core.formats.topics import CONDITIONS, RAW

CONDITION_S = 10.0  # a condition that was not renewed for this long is not known any more

ABSENT_NS = NANO  # a joint that no message has named for so long is left out; shorter, its values are missing


class Columns(NamedTuple):
    """One raw message: names of its joints, and its channels, each of shape (joints,)."""

    joints: tuple[str, ...]
    channels: Mapping[str, Array]


class AlignedSample(NamedTuple):
    """All joints at one instant; channels of shape (joints,), NaN for unknown values."""

    instant_ns: int
    joints: Sequence[str]
    channels: Mapping[str, Array]
    derived: frozenset[str]


class Aligner:
    """Joins the raw topics by stamp, converts motor quantities to SI units at the motor shaft, and filters them.

    Attributes:
        joints: the joints seen in the last second, in the order of appearance; channels have the same order.
        filter: the filter; its `events` say what happened to the data.
    """

    def __init__(
        self,
        inputs: InputOptions,
        options: FilterOptions | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Build an aligner; `clock` returns the real time in s."""
        self.joints: list[str] = []
        self.filter = StreamingFilter(options)
        self._inputs = inputs
        self._joiner: Joiner[Columns] = Joiner([t.name for t in RAW], inputs.join_wait_s, clock)
        self._origin_ns = self._last_ns = 0  # first and last instant of this run
        self._begun = False
        self._conditions: dict[str, tuple[int, dict[str, float]]] = {}  # by joint: stamp in ns, value by channel
        self._heard: dict[str, int] = {}  # last instant in ns at which a joint was named

    def add(self, topic: str, stamp_ns: int, columns: Columns) -> list[AlignedSample]:
        """Add one message of `formats.topics.RAW` or `CONDITIONS`; return the samples that became complete.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
        if topic == CONDITIONS.name:
            for i, joint in enumerate(columns.joints):
                self._conditions[joint] = stamp_ns, {n: float(v[i]) for n, v in columns.channels.items()}
            return []
        return list(self._align(self._joiner.add(topic, stamp_ns, columns)))

    def release(self) -> list[AlignedSample]:
        """Return samples that need not wait any longer; call it regularly while no message arrives."""
        return list(self._align(self._joiner.release(idle=True)))

    def new_rate(self, why: str) -> list[AlignedSample]:
        """Restart the filter for another sampling rate; return the samples that waited."""
        return list(map(self._sample, self.filter.restart(why, new_rate=True)))

    def _align(self, complete: list[tuple[int, dict[str, Columns]]]) -> Iterator[AlignedSample]:
        for stamp_ns, parts in complete:
            if not self._begun or is_new_run(self._last_ns, stamp_ns):
                if self._begun:
                    step_s = seconds(stamp_ns, self._last_ns)
                    yield from map(self._sample, self.filter.restart(f"time jumps by {step_s:.9g} s"))
                self._begun, self._origin_ns = True, stamp_ns
            self._last_ns = stamp_ns
            yield from self._leave_out_absent(stamp_ns, parts.values())
            channels = self._inputs.channels(self._table(list(parts.values())))
            yield from map(self._sample, self.filter.push(seconds(stamp_ns, self._origin_ns), channels))

    def _leave_out_absent(self, stamp_ns: int, parts: Iterable[Columns]) -> Iterator[AlignedSample]:
        """Forget joints that disappeared; yield the samples that waited, which still have them."""
        self._heard |= dict.fromkeys((joint for part in parts for joint in part.joints), stamp_ns)
        absent = [j for j in self.joints if not -BACK_NS <= stamp_ns - self._heard[j] <= ABSENT_NS]
        if absent:
            yield from map(self._sample, self.filter.restart(f"no values of {', '.join(absent)} any more"))
            self.joints = [joint for joint in self.joints if joint not in absent]

    def _table(self, parts: Sequence[Columns]) -> dict[str, Array]:
        """Return the channels of all joints at one instant, NaN for joints without a value."""
        for part in parts:
            self.joints += [joint for joint in part.joints if joint not in self.joints]
        table = {}
        for part in parts:
            rows = [self.joints.index(joint) for joint in part.joints]
            for name, values in part.channels.items():
                table[name] = np.full(len(self.joints), np.nan)
                table[name][rows] = values
        return table

    def _sample(self, sample: FilteredSample) -> AlignedSample:
        # A sample that waited in the filter does not have the joints that were first seen after it.
        joints = self.joints[: len(next(iter(sample.channels.values()), ()))]
        instant_ns = instant(sample.time, self._origin_ns)
        channels = {**sample.channels, **self._held(joints, instant_ns)} if self._conditions else sample.channels
        return AlignedSample(instant_ns, joints, channels, sample.derived)

    def _held(self, joints: Sequence[str], instant_ns: int) -> dict[str, Array]:
        """Return the newest conditions of the joints, NaN where they are not known at this instant."""
        held = {name: np.full(len(joints), np.nan) for name in CONDITIONS.fields.values()}
        for i, joint in enumerate(joints):
            stamp_ns, values = self._conditions.get(joint, (0, {}))
            if abs(seconds(instant_ns, stamp_ns)) <= CONDITION_S:
                for name, value in values.items():
                    held[name][i] = value
        return held
