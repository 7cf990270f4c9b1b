"""The torques of a recording of all joints beside what each parameter of an arm makes of them, below one frequency.

Inverse dynamics with a parallel low-pass: both sides of every equation pass the same filter, forwards and backwards,
and few samples of what is left are kept (Gautier, Janot & Vandanjon, IEEE Transactions on Control Systems Technology
21, 2013).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.gains import Gains
from joint_id_core.arm.motion import bridging, motion, require_recorded
from joint_id_core.arm.regressor import OF_LINK, Regressor
from joint_id_core.checking.findings import findings
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions, differentiate, smoothed

PAYLOAD = len(OF_LINK)  # parameters of a payload: those of a link
BAND_HZ = 8.0  # of the equations: an arm moves below it, and friction is as its law says
RATE = 100.0  # instants in a second at which torques are computed, before the filter
KEPT = 5  # every so many of them is kept after it: 20 in a second
SLOW = 0.01  # rad/s, over about twice of which Coulomb friction turns: gears yield before they slip
REST, REST_S = 0.005, 0.25  # rad/s, s: a joint that is slower for so long rests, and sticks with any torque
TURNED = 0.01  # how far filtered Coulomb friction of 1 is from it where a reversal does not count
POSITION, DRIVES = "link_position", ("torque", "current")
STANDS = 5e-3  # rad, range of the position of a joint that stands, and does not move by the noise of its encoder
MOVED = 0.02  # rad, standard deviation of the position of a joint that was not still


@dataclass(frozen=True)
class Unfiltered:
    """What equations are made of, at T instants, `RATE` in a second.

    Attributes:
        inertial: torques in Nm by unit inertial parameters, those of the arm and of a payload, (T, n, base + PAYLOAD).
        dq: velocities in rad/s, (T, n).
        known: whether the motion is, (T,).
    """

    inertial: Array
    dq: Array
    known: NDArray[np.bool_]


@dataclass(frozen=True)
class Equations:
    """Torques of n joints at R instants.

    Attributes:
        time: instants in s, shape (R,), in the time of the recording of the first joint.
        y, rate: torque at the link in Nm, and how fast it changes in Nm/s, shape (R, n).
        columns: torques by unit parameters, shape (R, n, P): `base` base parameters, `PAYLOAD` of a payload on the last
            link, viscous friction, Coulomb friction, and what `friction` adds.
        precision: 1 / variance of each parameter about 0 that is known beforehand, shape (P,); 0 if nothing is.
        q, dq: positions in rad and velocities in rad/s, shape (R, n).
        used: whether an equation counts: the torque is known, and the joint does not rest, shape (R, n).
        rests: whether the torque is known, and the joint rests, shape (R, n).
        duration: time in s in which the arm moves.
        loaded: whether the arm carries the payload.
        doubts: what the checks of the recordings found.
        unfiltered: for columns that are added later; None of a part of a recording.
    """

    time: Array
    y: Array
    rate: Array
    columns: Array
    precision: Array
    q: Array
    dq: Array
    used: NDArray[np.bool_]
    rests: NDArray[np.bool_]
    duration: float
    base: int
    loaded: bool
    doubts: tuple[str, ...] = ()
    unfiltered: Unfiltered | None = None

    def between(self, begin: float, end: float) -> Equations:
        """Return the equations of begin <= time < end."""
        i, j = np.searchsorted(self.time, [begin, end])
        some = slice(int(i), int(j))
        moving = float(np.count_nonzero(self.used[some].any(axis=1))) * KEPT / RATE
        return replace(
            self, time=self.time[some], y=self.y[some], rate=self.rate[some], columns=self.columns[some],
            q=self.q[some], dq=self.dq[some], used=self.used[some], rests=self.rests[some], duration=moving,
            unfiltered=None,
        )  # fmt: skip

    def scaled(self, gains: Array) -> Equations:
        """Return the equations with torques that are larger by factors, (n,)."""
        return replace(self, y=self.y * gains, rate=self.rate * gains)

    @property
    def ddq(self) -> Array:
        """Accelerations in rad/s^2 below the band, (R, n): torques of unit rotors, which are the first parameters."""
        own = np.arange(self.q.shape[1])
        return np.asarray(self.columns[:, own, own])

    @property
    def steady(self) -> Equations:
        """The equations of joints that do not reverse nearby, where friction turns in a way of its own."""
        count = self.used.shape[1]
        own = np.arange(count)
        coulomb = np.abs(self.columns[:, own, self.base + PAYLOAD + count + own])
        return replace(self, used=self.used & (np.abs(coulomb - 1.0) < TURNED))


def joined(parts: Sequence[Equations]) -> Equations:
    """Return parts of one recording as one."""
    time, y, rate, columns, q, dq, used, rests = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("time", "y", "rate", "columns", "q", "dq", "used", "rests")
    )
    duration = sum(p.duration for p in parts)
    return replace(
        parts[0],
        time=time,
        y=y,
        rate=rate,
        columns=columns,
        q=q,
        dq=dq,
        used=used,
        rests=rests,
        duration=duration,
        unfiltered=None,
    )


def equations(
    regressor: Regressor,
    recordings: Mapping[str, Recording],
    gains: Gains,
    source: str,
    loaded: bool = False,
) -> Equations:
    """Return the equations of a recording.

    Args:
        regressor: of the arm.
        recordings: of all its joints, by name; of others that shall stand still, if there are any.
        gains: by joint and drive ("torque", "current"), the torque at the link in Nm of one unit of it.
        source: of the joints, for messages.
        loaded: whether the arm carries the payload.

    Raises:
        JointIdError: a joint was not recorded, or no link position, torque or current of it; a gain is not given; the
            joints were not recorded at the same time, or none moves.
    """
    require_recorded(recordings, regressor.joints, source)
    doubts = (*_doubts(recordings, regressor.joints), *_fixed_in_vain(recordings, regressor.joints, source))
    found = unchecked(regressor, recordings, gains, source, loaded)
    if not found.used.any():
        raise JointIdError(f"{recordings[regressor.joints[0]].source}: no joint moves: record a motion of the arm")
    return replace(found, doubts=doubts)


def unchecked(
    regressor: Regressor,
    recordings: Mapping[str, Recording],
    gains: Gains,
    source: str,
    loaded: bool = False,
) -> Equations:
    """Return the equations of a recording that is not checked, perhaps of an arm at rest; see `equations`.

    Raises:
        JointIdError: as `equations`, but for joints that rest and what the checks find.
    """
    joints, count = regressor.joints, len(regressor.joints)
    first = recordings[joints[0]]
    begin = max(r.origin - first.origin + float(r.time[0]) for r in map(recordings.__getitem__, joints))
    end = min(r.origin - first.origin + float(r.time[-1]) for r in map(recordings.__getitem__, joints))
    time = np.arange(begin, end, 1.0 / RATE)
    if len(time) < 10 * KEPT:
        raise JointIdError(f"{first.source}: the joints were not recorded at the same time, or for less than 0.5 s")
    like = Recording(time, {}, source=first.source, origin=first.origin)
    q, dq, ddq = motion(recordings, joints, like, source)
    known = np.isfinite(np.concatenate([q, dq, ddq], axis=1)).all(axis=1)
    if known.any():
        stands = np.ptp(q[known], axis=0) < STANDS
        q[:, stands], dq[:, stands], ddq[:, stands] = np.median(q[known], axis=0)[stands], 0.0, 0.0
    base = len(regressor.reference)
    inertial = np.full((len(time), count, base + PAYLOAD), np.nan)
    inertial[known] = np.concatenate(regressor.rows(q[known], dq[known], ddq[known]), axis=2)
    own = np.eye(count)
    columns = np.concatenate([inertial, dq[:, :, None] * own, np.tanh(dq / SLOW)[:, :, None] * own], axis=2)
    y = np.array([_torque(recordings[name], gains.get(name, {}), name, like) for name in joints]).T
    rate = np.nan_to_num(np.gradient(y, 1.0 / RATE, axis=0))
    columns, kept = below_band(columns, known), slice(None, None, KEPT)
    told, rests = np.isfinite(y) & np.isfinite(columns).all(axis=2), _rests(dq)
    used = told & ~rests
    moving = float(np.count_nonzero(used.any(axis=1))) / RATE
    unfiltered = Unfiltered(inertial, dq, known)
    return Equations(
        time[kept], y[kept], rate[kept], columns[kept], np.zeros(columns.shape[2]), q[kept], dq[kept], used[kept],
        (told & rests)[kept], moving, base, loaded, unfiltered=unfiltered,
    )  # fmt: skip


def below_band(columns: Array, known: NDArray[np.bool_]) -> Array:
    """Return columns (T, n, P) below the band; NaN where the motion is not known, (T,)."""
    found, low = np.where(known[:, None, None], columns, np.nan), FilterOptions(cutoff_hz=BAND_HZ)
    filled = np.any(columns[known] != 0.0, axis=0)  # half of them are not
    for piece in np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1):
        if known[piece[0]]:
            found[piece[:, None], filled] = smoothed(columns[piece][:, filled], 1.0 / RATE, low)
    return found


def _doubts(recordings: Mapping[str, Recording], joints: Sequence[str]) -> tuple[str, ...]:
    """Return what the checks of the recordings doubt; what they find alike in several joints is told once.

    Raises:
        JointIdError: one of them is of no use, as with angles in degrees.
    """
    told: dict[str, tuple[str, list[str]]] = {}
    used = {POSITION, *DRIVES}
    for name in joints:
        for finding in findings(recordings[name]):
            if finding.fatal and (not finding.channels or used & {*finding.channels}):
                raise JointIdError(f"{recordings[name].source}: joint {name}: {finding.text}")
            if not finding.fatal and used >= {*finding.channels}:
                alike = re.sub(r"\d[\d.,e+-]*", "", finding.text)
                told.setdefault(alike, (finding.text, []))[1].append(name)
    source = recordings[joints[0]].source
    return tuple(f"{source}, {_names(names)}: {text}" for text, names in told.values())


def _names(joints: Sequence[str]) -> str:
    first, *others = joints
    return f"joint {first}" + (f" (alike: {', '.join(others)})" if others else "")


def _fixed_in_vain(recordings: Mapping[str, Recording], joints: Sequence[str], source: str) -> list[str]:
    """Return doubts about recorded joints that move, and do not in the description."""
    return [
        f"{recording.source}: {name} moves, and does not in {source}: what it does to the other joints is taken for "
        "something else"
        for name, recording in recordings.items()
        if name not in joints and recording.measured(POSITION) and np.nanstd(recording[POSITION]) > MOVED
    ]


def _torque(recording: Recording, gains: Mapping[str, float], name: str, like: Recording) -> Array:
    """Return the torque of a joint at the link, below the band, at the instants of `like`."""
    drive = next((d for d in DRIVES if recording.measured(d)), None)
    if drive is None:
        raise JointIdError(f"{recording.source}: joint {name} has no torque and no current: record one of them")
    if drive not in gains:
        raise JointIdError(
            f"{recording.source}: joint {name} has a current: give its torque constant and gear ratio (--robot, or "
            f"--set {name}.k_t=0.1 --set {name}.N=101)"
        )
    options = bridging(FilterOptions(cutoff_hz=BAND_HZ), recording.period)
    values = differentiate(recording.time, recording[drive], options, 0, recording.source)[0]
    known = np.isfinite(values)
    if np.count_nonzero(known) < 2:
        return np.full(len(like), np.nan)
    # What is recorded acts until the next sample: in the mean half a step later.
    time = recording.time[known] + float(recording.origin - like.origin) + 0.5 * recording.period
    gap = np.diff(time) > options.max_gap * recording.period
    after = np.clip(np.searchsorted(time, like.time) - 1, 0, len(gap) - 1)
    return np.where(gap[after], np.nan, gains[drive] * np.interp(like.time, time, values[known], np.nan, np.nan))


def _rests(dq: Array) -> NDArray[np.bool_]:
    """Return where each joint rests, from velocities (T, n)."""
    length = round(REST_S * RATE)
    slow = np.abs(np.nan_to_num(dq)) < REST
    sums = np.cumsum(np.concatenate([np.zeros((1, dq.shape[1])), slow]), axis=0)
    whole = sums[length:] - sums[:-length] == length  # windows that are slow throughout
    found = np.zeros_like(slow)
    for shift in range(length):
        found[shift : shift + len(whole)] |= whole
    return found
