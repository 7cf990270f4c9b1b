"""The load of the arm, added to the samples of all joints as they arrive: what `loaded` does with whole recordings."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.alignment.joining import is_new_run
from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import means_over_steps
from joint_id_core.arm.motion import CUTOFF_HZ
from joint_id_core.arm.typical_inertia import typical_inertia
from joint_id_core.data.instants import seconds
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import FilteredSamples, StreamingFilter

POSITION, VELOCITY, ACCELERATION = "link_position", "link_velocity", "link_acceleration"


def with_unknown_load(samples: AlignedSamples) -> AlignedSamples:
    """Return samples whose load is not known."""
    return _loaded(samples, np.full((len(samples.instants_ns), len(samples.joints)), np.nan))


class OnlineLoad:
    """Adds the load that the rest of the arm puts on each joint, as the derived channel `external_torque`.

    That needs the positions of all joints of the description at the instant of a sample. The load is NaN where one of
    them is missing and shortly after, and for joints that the description does not have. All samples leave in the order
    in which they came, `latency` later; a joint that is late or missing holds none back.

    Attributes:
        missing: joints of the description without a position in the newest samples.
        unloaded: why no load is computed for some joints, by joint.
    """

    def __init__(self, description: Description, max_gap: float) -> None:
        """Prepare; gaps of up to `max_gap` periods are bridged."""
        self.missing: tuple[str, ...] = ()
        self.unloaded: dict[str, str] = {}
        self._description, self._inertia = description, typical_inertia(description)
        self._filter = StreamingFilter(FilterOptions(cutoff_hz=CUTOFF_HZ, max_gap=max_gap))
        self._origin_ns, self._newest_ns = 0, -1
        self._waiting: deque[AlignedSamples] = deque()  # in the order in which they came
        self._last = _Loads(np.empty(0), np.empty((0, len(description.joints))))  # of a sample that awaits the next one
        self._turn = np.where(description.turning, 2.0 * np.pi, 0.0)  # rad, after which a position is the same
        self._position = np.full(len(description.joints), np.nan)  # newest ones
        self._places: dict[tuple[str, ...], list[int]] = {}  # of the joints of samples, in the loads

    @property
    def latency(self) -> float:
        """Time in s from the arrival of a sample to its return; NaN until the sampling period is known."""
        return self._filter.latency + self._filter.period

    def add(self, samples: AlignedSamples) -> list[AlignedSamples]:
        """Take later samples, and return those whose load has become known, or never will."""
        first_ns, done = samples.instants_ns[0], list[AlignedSamples]()
        if self._newest_ns < 0 or first_ns <= self._newest_ns or is_new_run(self._newest_ns, first_ns):
            done = self.release()
            self._origin_ns = first_ns
        self._newest_ns = samples.instants_ns[-1]
        self._waiting.append(samples)
        times = [seconds(ns, self._origin_ns) for ns in samples.instants_ns]
        results = self._filter.push(times, {POSITION: self._positions(samples)})
        return done + self._leave(results, self._filter.period)

    def release(self) -> list[AlignedSamples]:
        """Return all samples that wait, and begin anew; those whose load needs later samples are without."""
        period = self._filter.period
        done = self._leave(self._filter.restart("released", new_rate=True), period)
        loads, self._last = self._last.torque, _Loads(np.empty(0), self._last.torque[:0])
        return done + self._with(loads)

    def _positions(self, samples: AlignedSamples) -> Array:
        """Return the positions of the joints of the description, shape (T, joints)."""
        joints, known = self._description.joints, samples.channels.get(POSITION)
        positions = np.full((len(samples.instants_ns), len(joints)), np.nan)
        if known is not None:
            there = [name for name in joints if name in samples.joints]
            positions[:, [joints.index(name) for name in there]] = known[:, [samples.joints.index(n) for n in there]]
        for row in positions:  # those of joints that turn for ever may jump by a turn
            row -= np.nan_to_num(np.round((row - self._position) / (2.0 * np.pi))) * self._turn
            self._position = np.where(np.isnan(row), self._position, row)
        lacking = np.isnan(positions).all(axis=0)
        self.missing = tuple(name for name, lacks in zip(joints, lacking.tolist(), strict=True) if lacks)
        return positions

    def _leave(self, results: Sequence[FilteredSamples], period: float) -> list[AlignedSamples]:
        """Return the samples whose load, and that of the next sample, has become known; `period` in s."""
        if not results:
            return []
        q, dq, ddq = (np.concatenate([r.channels[n] for r in results]) for n in (POSITION, VELOCITY, ACCELERATION))
        load = self._description.loads(q, dq, ddq)
        torque = np.concatenate([self._last.torque, load.torque + (load.inertia - self._inertia) * ddq])
        time = np.concatenate([self._last.time, *(r.times for r in results)])
        self._last = _Loads(time[-1:], torque[-1:])
        return self._with(means_over_steps(time, torque, period)[:-1])

    def _with(self, loads: Array) -> list[AlignedSamples]:
        """Return the first samples that wait, as many as there are loads, with these, shape (T, joints)."""
        done = []
        while len(loads):
            samples = self._waiting.popleft()
            count = min(len(loads), len(samples.instants_ns))
            if count < len(samples.instants_ns):
                self._waiting.appendleft(_rows(samples, slice(count, None)))
                samples = _rows(samples, slice(count))
            places = self._places_of(tuple(samples.joints))
            done.append(_loaded(samples, np.column_stack([loads[:count], np.full(count, np.nan)])[:, places]))
            loads = loads[count:]
        return done

    def _places_of(self, joints: tuple[str, ...]) -> list[int]:
        """Return the columns of these joints in the loads, the one behind the last for those without a load."""
        if joints not in self._places:
            self.unloaded = {name: why for name in joints if (why := self._refused(name))}
            known = self._description.joints
            self._places = {joints: [len(known) if n in self.unloaded else known.index(n) for n in joints]}
        return self._places[joints]

    def _refused(self, joint: str) -> str:
        """Return why a joint has no load; empty if it has one."""
        try:
            self._description.require(joint)
        except JointIdError as error:
            return str(error)
        return ""


class _Loads(NamedTuple):
    """Loads (T, joints) in Nm at instants (T,) in s."""

    time: Array
    torque: Array


def _rows(samples: AlignedSamples, rows: slice) -> AlignedSamples:
    """Return some of the samples."""
    channels = {name: values[rows] for name, values in samples.channels.items()}
    return samples._replace(instants_ns=samples.instants_ns[rows], channels=channels)


def _loaded(samples: AlignedSamples, load: Array) -> AlignedSamples:
    """Return samples with a load, shape (T, joints)."""
    return samples._replace(channels={**samples.channels, LOAD: load}, derived=samples.derived | {LOAD})
