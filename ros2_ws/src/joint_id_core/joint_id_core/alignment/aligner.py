"""Align raw topics: build samples of all joints at one instant and add velocities and accelerations."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.alignment.joining import BACK_NS, Joiner, is_new_run
from joint_id_core.data.instants import NANO, instant, seconds
from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import FilteredSamples, StreamingFilter
from joint_id_core.formats.topics import CONDITIONS, RAW

CONDITION_S = 10.0  # a condition that was not renewed for this long is not known any more

ABSENT_NS = NANO  # a joint that no message has named for so long is left out; shorter, its values are missing


class Columns(NamedTuple):
    """One raw message: names of its joints, and its channels, each of shape (joints,)."""

    joints: tuple[str, ...]
    channels: Mapping[str, Array]


_Row = tuple[int, dict[str, Columns]]  # stamp in ns, message by topic


class AlignedSamples(NamedTuple):
    """All joints at T instants; channels of shape (T, joints), NaN for unknown values."""

    instants_ns: Sequence[int]
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
        self._complete: list[_Row] = []  # joined, not filtered yet

    def join(self, topic: str, stamp_ns: int, columns: Columns) -> None:
        """Take one message of `formats.topics.RAW` or `CONDITIONS`; `align` returns what became complete.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
        if topic == CONDITIONS.name:
            for i, joint in enumerate(columns.joints):
                self._conditions[joint] = stamp_ns, {n: float(v[i]) for n, v in columns.channels.items()}
            return
        self._complete += self._joiner.add(topic, stamp_ns, columns)

    def align(self) -> list[AlignedSamples]:
        """Return the samples that became complete; call it after one or many messages."""
        complete, self._complete = self._complete, []
        done: list[AlignedSamples] = []
        for _, alike in groupby(complete, key=_form):
            rows: list[_Row] = []
            for row in alike:
                if not self._begun or is_new_run(self._last_ns, row[0]):
                    done += self._filter(rows)
                    done += self._begin(row[0])
                    rows = []
                self._last_ns = row[0]
                if absent := self._absent(row[0], row[1].values()):
                    done += self._filter(rows)
                    done += self._leave_out(absent)
                    rows = []
                rows.append(row)
            done += self._filter(rows)
        return done

    def release(self) -> list[AlignedSamples]:
        """Return samples that need not wait any longer; call it regularly while no message arrives."""
        self._complete += self._joiner.release(idle=True)
        return self.align()

    @property
    def waiting(self) -> bool:
        """Whether messages wait for those of other topics."""
        return self._joiner.waiting

    def new_rate(self, why: str) -> list[AlignedSamples]:
        """Restart the filter for another sampling rate; return the samples that waited."""
        return self.align() + self._restart(why, new_rate=True)

    def _restart(self, why: str, new_rate: bool = False) -> list[AlignedSamples]:
        return [self._samples(samples) for samples in self.filter.restart(why, new_rate)]

    def _begin(self, stamp_ns: int) -> list[AlignedSamples]:
        """Begin a new run; return the samples of the last one that waited in the filter."""
        done: list[AlignedSamples] = []
        if self._begun:
            done = self._restart(f"time jumps by {seconds(stamp_ns, self._last_ns):.9g} s")
        self._begun, self._origin_ns = True, stamp_ns
        return done

    def _absent(self, stamp_ns: int, parts: Iterable[Columns]) -> list[str]:
        """Return the joints that disappeared before a sample."""
        for part in parts:
            self._heard |= dict.fromkeys(part.joints, stamp_ns)
        return [j for j in self.joints if not -BACK_NS <= stamp_ns - self._heard[j] <= ABSENT_NS]

    def _leave_out(self, absent: Sequence[str]) -> list[AlignedSamples]:
        """Forget joints; return the samples that waited in the filter, which still have them."""
        done = self._restart(f"no values of {', '.join(absent)} any more")
        self.joints = [joint for joint in self.joints if joint not in absent]
        return done

    def _filter(self, rows: Sequence[_Row]) -> list[AlignedSamples]:
        """Filter samples of one run that have the same topics, joints and channels."""
        if not rows:
            return []
        times = [seconds(stamp_ns, self._origin_ns) for stamp_ns, _ in rows]
        channels = self._inputs.channels(self._table([list(parts.values()) for _, parts in rows]))
        return [self._samples(samples) for samples in self.filter.push(times, channels)]

    def _table(self, rows: Sequence[Sequence[Columns]]) -> dict[str, Array]:
        """Return the channels of all joints, shape (T, joints), NaN for joints without a value."""
        for part in rows[0]:
            self.joints += [joint for joint in part.joints if joint not in self.joints]
        table = {}
        for k, part in enumerate(rows[0]):
            places = [self.joints.index(joint) for joint in part.joints]
            for name in part.channels:
                table[name] = np.full((len(rows), len(self.joints)), np.nan)
                table[name][:, places] = [parts[k].channels[name] for parts in rows]
        return table

    def _samples(self, samples: FilteredSamples) -> AlignedSamples:
        # A sample that waited in the filter does not have the joints that were first seen after it.
        joints = self.joints[: next(iter(samples.channels.values())).shape[1]] if samples.channels else []
        instants_ns = [instant(time, self._origin_ns) for time in samples.times]
        held = self._held(joints, instants_ns) if self._conditions else {}
        return AlignedSamples(instants_ns, joints, {**samples.channels, **held}, samples.derived)

    def _held(self, joints: Sequence[str], instants_ns: Sequence[int]) -> dict[str, Array]:
        """Return the newest conditions of the joints, shape (T, joints), NaN where they are not known."""
        instants = np.array(instants_ns, dtype=np.int64)
        held = {name: np.full((len(instants), len(joints)), np.nan) for name in CONDITIONS.fields.values()}
        for i, joint in enumerate(joints):
            stamp_ns, values = self._conditions.get(joint, (0, {}))
            known = np.abs(instants - stamp_ns) <= CONDITION_S * NANO
            for name, value in values.items():
                held[name][known, i] = value
        return held


def _form(row: _Row) -> tuple[object, ...]:
    """Return what two samples must have in common to be filtered at once."""
    return tuple((topic, part.joints, tuple(part.channels)) for topic, part in row[1].items())
