"""Samples of all joints of an arm that come in batches, made into equations half a second at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from joint_id_core.arm.equations import DRIVES, PAYLOAD, POSITION, Equations, unchecked
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError

BLOCK_S = 0.5  # of a block of equations
# Samples on either side of a block that its filters need: 0.1 s for derivatives to settle, and the response of the
# low-pass of the equations, of which less than a thousandth is left after 0.3 s.
MARGIN_S = 0.4
WAIT_S = 3.0  # a joint whose samples are further behind those of the others is missing
NEEDED = (POSITION, *DRIVES)


class ArmStream:
    """Keeps the newest samples of all joints, and makes every half second of them into equations.

    The equations are those of `equations`: the filters run forwards and backwards over a block and its margins.
    """

    def __init__(self, regressor: Regressor, gains: Gains, source: str) -> None:
        """Begin without samples; `gains` and `source` as for `equations`."""
        self._regressor, self._gains, self._source = regressor, gains, source
        self._samples: dict[str, Recording] = {}
        self._end: float | None = None  # of the last block
        self._friction = Friction.from_values(regressor, np.append(regressor.reference, np.zeros(PAYLOAD)))
        self._carries = False

    def know(self, values: Array, carries: bool) -> None:
        """Take what is known of the inertial parameters, (base + PAYLOAD,) or more: friction depends on the load."""
        count, rigid = len(self._regressor.joints), self._friction.rigid.copy()
        rigid[count:] = values[count : len(rigid)]  # a gear does not pass on what turns the rotor
        self._friction, self._carries = replace(self._friction, rigid=rigid), carries

    def push(self, records: Mapping[str, Recording]) -> list[Equations]:
        """Add samples of some joints, later than those before and with the same origin; return what became complete.

        Raises:
            JointIdError: samples of a joint are not later than those before, or do not come; it has no link position,
                and no torque or current with a gain. The samples are left out.
        """
        joints = self._regressor.joints
        added = {name: _joined(self._samples.get(name), records[name]) for name in joints if name in records}
        self._samples |= added
        newest = {name: float(r.time[-1]) if len(r) else -np.inf for name, r in self._samples.items()}
        if not newest:
            return []
        last = max(newest.values())
        if late := [name for name in joints if newest.get(name, -np.inf) < last - WAIT_S]:
            self._forget(last - WAIT_S)
            if last - min(float(r.time[0]) for r in self._samples.values()) > WAIT_S - BLOCK_S:
                raise JointIdError(
                    f"no samples of {', '.join(late)}, which {self._source} moves (there are {', '.join(newest)}): "
                    "joints are found by name. Publish all joints, or make one that stands still fixed in a copy of "
                    "the description"
                )
        if len(newest) < len(joints):
            return []
        begun = max(float(r.time[0]) for r in self._samples.values()) + MARGIN_S
        ready, found = min(newest.values()) - MARGIN_S, []
        begin = begun if self._end is None else max(self._end, begun)
        while begin + BLOCK_S <= ready:
            found += self._block(begin)
            begin = self._end = begin + BLOCK_S
        self._forget(begin - MARGIN_S)
        return found

    def _block(self, begin: float) -> list[Equations]:
        """Return the equations of a block; none where samples of a joint are missing."""
        ends = begin - MARGIN_S, begin + BLOCK_S + MARGIN_S
        records = {name: self._samples[name].window(*ends) for name in self._regressor.joints}
        if any(len(record) < 2 for record in records.values()):
            return []
        first, last = (np.array([r.time[k] for r in records.values()]) for k in (0, -1))
        if last.min() - first.max() < BLOCK_S + MARGIN_S:
            return []
        found = unchecked(self._regressor, records, self._gains, self._source, self._carries)
        return [self._friction.added(found).between(begin, begin + BLOCK_S)]

    def _forget(self, before: float) -> None:
        """Forget samples from before an instant."""
        self._samples = {name: r.window(before, np.inf) for name, r in self._samples.items()}


def _joined(old: Recording | None, new: Recording) -> Recording:
    """Return the channels that are needed of two recordings of a joint, one after the other."""
    own = {name: new[name] for name in NEEDED if new.measured(name)}
    if old is None or not len(old):
        return new.trusted(new.time, own, frozenset())
    if not len(new):
        return old
    if not new.time[0] > old.time[-1]:
        raise JointIdError(
            f"{new.source}: samples of joint {new.joint} at {new.time[0]:.6g} s after those at {old.time[-1]:.6g} s: "
            "they are left out"
        )
    names = dict.fromkeys((*old.channels, *own))
    nothing = {part: np.full(len(r), np.nan) for part, r in (("old", old), ("new", new))}
    channels = {
        name: np.concatenate([old.channels.get(name, nothing["old"]), own.get(name, nothing["new"])]) for name in names
    }
    if POSITION in channels:
        channels[POSITION] = _unwrapped(channels[POSITION])
    return new.trusted(np.concatenate([old.time, new.time]), channels, frozenset())


def _unwrapped(position: Array) -> Array:
    """Return positions in rad (T,) without jumps by a turn, as those of joints that turn for ever have."""
    found, known = position.copy(), np.isfinite(position)
    found[known] = np.unwrap(position[known])
    return found
