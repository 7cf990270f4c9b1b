"""Align raw topics: build samples of all joints at one instant and add velocities and accelerations."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.alignment.joining import Joiner, is_new_run
from joint_id_core.data.instants import instant, seconds
from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import FilteredSamples, StreamingFilter
from joint_id_core.formats.topics import RAW


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
        joints: every joint seen so far, in the order of appearance; channels have the same order.
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
        self._complete: list[_Row] = []  # joined, not filtered yet

    def join(self, topic: str, stamp_ns: int, columns: Columns) -> None:
        """Take one message of a topic in `formats.topics.RAW`; `align` returns what became complete.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
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
                rows.append(row)
            done += self._filter(rows)
        return done

    def release(self) -> list[AlignedSamples]:
        """Return samples that need not wait any longer; call it regularly while no message arrives."""
        self._complete += self._joiner.release(idle=True)
        return self.align()

    def _begin(self, stamp_ns: int) -> list[AlignedSamples]:
        """Begin a new run; return the samples of the last one that waited in the filter."""
        done: list[AlignedSamples] = []
        if self._begun:
            step_s = seconds(stamp_ns, self._last_ns)
            done = [self._samples(samples) for samples in self.filter.restart(f"time jumps by {step_s:.9g} s")]
        self._begun, self._origin_ns = True, stamp_ns
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
        return AlignedSamples(instants_ns, joints, samples.channels, samples.derived)


def _form(row: _Row) -> tuple[object, ...]:
    """Return what two samples must have in common to be filtered at once."""
    return tuple((topic, part.joints, tuple(part.channels)) for topic, part in row[1].items())
