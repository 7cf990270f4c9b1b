"""Watch the publisher of a topic: lost samples, sampling rate, clock, joints, other publishers.

Everything follows from what comes with a message: its stamp, the names of its joints, the number that its publisher
gave it (every publisher counts its own messages), and how long it waited until it was read.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from joint_id_core.alignment.joining import is_new_run
from joint_id_core.data.instants import NANO

STEPS = 20  # time steps from which the sampling period is found
LIKE = 0.1  # relative difference of a time step from the period up to which it counts as one period
STEADY = 15  # of `STEPS` steps must be alike, else a stream has no period
OTHER_RATE = 1.25  # ratio of two periods from which the sampling rate has changed
GAP = 1.75  # periods from which samples are missing between two stamps: one missing sample makes 2
JUMP_NS = NANO  # by this much the stamps must run ahead of the real time before a clock is blamed
SLOW_S = 0.5  # a message that waited this long was read too late: then a loss is the fault of the reader
LEAP = 1000  # of two publishers the one is followed whose count is this close
SILENT_S = 1.0  # after this silence of the publisher that is followed, another one is

SOURCE, NETWORK, HERE = "source", "network", "this computer"  # who lost samples


class SourceEvent(NamedTuple):
    """What happened: a kind that does not change, and a sentence."""

    kind: str
    text: str


RATE, CLOCK, JOINTS, REPLACED = "rate changed", "clock jumped", "joints changed", "publisher replaced"
LOST = {who: f"lost by {who}" for who in (SOURCE, NETWORK, HERE)}


class SourceWatch:
    """Watches one topic.

    Attributes:
        publishers: number of publishers of the topic; the owner keeps it up to date, and is asked for it where the
            numbers of the messages are odd.
        lost: number of lost samples, by who lost them.
        foreign: number of messages of other publishers than the one that is followed.
        uncounted: whether the middleware does not number messages, so that publishers cannot be told apart.
        slowest_s: longest time that a message waited until it was read, in s; the owner resets it.
        events: what happened, oldest first; the owner takes them away.
    """

    def __init__(
        self, topic: str, clock: Callable[[], float] = time.monotonic, count: Callable[[], int] = lambda: 1
    ) -> None:
        """Build a watch; `clock` returns the real time in s, `count` the number of publishers now."""
        self.publishers, self._count = 1, count
        self.lost: Counter[str] = Counter()
        self.foreign = 0
        self.uncounted = False
        self.slowest_s = 0.0
        self.events: deque[SourceEvent] = deque()
        self._topic, self._clock = topic, clock
        self._stamp_ns: int | None = None
        self._sequence: int | None = None
        self._heard_s = clock()
        self._waited_s = 0.0
        self._steps: deque[int] = deque(maxlen=STEPS)
        self._since_check = 0
        self._period_ns: int | None = None
        self._gaps: list[int] = []  # steps with missing samples, unless they turn out to be a new period
        self._joints: tuple[str, ...] = ()
        self._other_joints: tuple[tuple[str, ...], int] = ((), 0)

    def admit(self, stamp_ns: int, joints: Sequence[str], sequence: int | None, waited_s: float = 0.0) -> bool:
        """Take a message into account; return False if it is of another publisher than the one that is followed.

        Args:
            stamp_ns: its stamp in ns.
            joints: names of its joints.
            sequence: number that its publisher gave it; None if the middleware does not tell.
            waited_s: time in s from its arrival at this computer until it was read.
        """
        now = self._clock()
        known, elapsed_s = self._sequence is not None and sequence is not None, now - self._heard_s
        ahead = (sequence or 0) - (self._sequence or 0)  # 1 if no message is missing
        if known and ahead != 1 and self.publishers == 1:
            self.publishers = self._count()  # a second one may have come since the owner looked
        if known and ahead != 1 and self.publishers > 1 and not 0 < ahead < LEAP and elapsed_s < SILENT_S:
            self.foreign += 1
            return False
        replaced = known and (ahead < 1 or (self.publishers > 1 and ahead >= LEAP))
        missing = ahead - 1 if known and not replaced else 0
        if replaced:
            self._tell(REPLACED, "the messages come from another publisher now")
        elif missing:
            self._lose(HERE if max(waited_s, self._waited_s) > SLOW_S else NETWORK, missing)
        if stamp_ns > 0:
            self._watch_stamp(stamp_ns, elapsed_s, whole=not missing)
        self._watch_joints(joints)
        self.uncounted = sequence is None
        self._sequence, self._heard_s, self._waited_s = sequence, now, waited_s
        self.slowest_s = max(self.slowest_s, waited_s)
        return True

    def usual(
        self, stamps_ns: Sequence[int], joints: tuple[str, ...], sequences: Sequence[int | None], waited_s: float
    ) -> bool:
        """Take messages of the same joints into account at once, if nothing about them calls for a closer look.

        Then none is missing, the joints are those of before, and the time steps are like the period. Else nothing is
        done, False is returned, and each message must be given to `admit`.

        Args:
            stamps_ns: their stamps in ns.
            joints: names of their joints.
            sequences: numbers that their publisher gave them.
            waited_s: the longest of the times in s from arrival until they were read.
        """
        period = self._period_ns
        if period is None or self._stamp_ns is None or self._sequence is None or self._gaps or joints != self._joints:
            return False
        next_one = self._sequence + 1
        steps = [stamp_ns - last for last, stamp_ns in zip((self._stamp_ns, *stamps_ns), stamps_ns, strict=False)]
        alike = (1.0 - LIKE) * period <= min(steps) and max(steps) <= (1.0 + LIKE) * period
        if not alike or list(sequences) != list(range(next_one, next_one + len(sequences))):
            return False
        self._note(steps)
        self._stamp_ns, self._sequence, self._other_joints = stamps_ns[-1], sequences[-1], ((), 0)
        self._heard_s, self._waited_s, self.uncounted = self._clock(), waited_s, False
        self.slowest_s = max(self.slowest_s, waited_s)
        return True

    def _tell(self, kind: str, text: str) -> None:
        self.events.append(SourceEvent(kind, f"{self._topic}: {text}"))

    def _lose(self, who: str, count: int) -> None:
        self.lost[who] += count
        reason = {
            SOURCE: "its publisher did not send them (their stamps are missing)",
            NETWORK: "the network did not deliver them",
            HERE: "this computer read them too late: it has too much to do",
        }[who]
        self._tell(LOST[who], f"{count} samples lost: {reason}")

    def _watch_stamp(self, stamp_ns: int, elapsed_s: float, whole: bool) -> None:
        """Compare a stamp with the previous one; `whole`: no message is missing between the two."""
        last, self._stamp_ns = self._stamp_ns, stamp_ns
        step = stamp_ns - last if last is not None else 0
        if last is None or is_new_run(last, stamp_ns):  # who orders the stamps reports a new run
            self._gaps.clear()
            return
        if step <= 0:
            self._stamp_ns = last
            return
        if step - elapsed_s * NANO > JUMP_NS and whole and step > GAP * (self._period_ns or step):
            text = f"the stamps jump ahead by {step / NANO:.6g} s while {elapsed_s:.3g} s passed: a clock was set, "
            self._tell(CLOCK, text + "or a recording has a pause")
            return
        if not whole:
            return
        period = self._period_ns
        if period is not None and step > GAP * period:
            self._gaps.append(step)
        elif period is not None and self._gaps and step > period / GAP:
            self._lose(SOURCE, sum(round(gap / period) - 1 for gap in self._gaps))
            self._gaps.clear()
        self._note([step])

    def _note(self, steps: Sequence[int]) -> None:
        """Find the period anew every few steps."""
        self._steps.extend(steps)
        self._since_check += len(steps)
        if self._since_check >= STEPS // 4 and len(self._steps) == STEPS:
            self._since_check = 0
            self._find_period()

    def _find_period(self) -> None:
        steps = sorted(self._steps)
        middle = steps[STEPS // 2]
        if steps[-1] - steps[0] > LIKE * middle and sum(abs(s - middle) <= LIKE * middle for s in steps) < STEADY:
            return
        period = self._period_ns
        if period is not None and not 1.0 / OTHER_RATE < middle / period < OTHER_RATE:
            self._tell(RATE, f"the sampling rate changed from {NANO / period:.4g} to {NANO / middle:.4g} Hz")
            self._gaps.clear()
        self._period_ns = middle

    def _watch_joints(self, joints: Sequence[str]) -> None:
        """Tell which joints appear and disappear for good; single messages may lack one."""
        names = tuple(joints)
        if names == self._joints or not names:
            self._other_joints = ((), 0)
            return
        other, count = self._other_joints
        self._other_joints = names, count + 1 if names == other else 1
        if self._joints and self._other_joints[1] < STEPS:
            return
        gone = [joint for joint in self._joints if joint not in names]
        new = [joint for joint in names if joint not in self._joints]
        if self._joints and (gone or new):
            parts = [f"{_listed(gone)} disappeared"] * bool(gone) + [f"{_listed(new)} appeared"] * bool(new)
            hint = ": has it got another name?" if len(gone) == len(new) == 1 else ""
            self._tell(JOINTS, " and ".join(parts) + hint)
        self._joints, self._other_joints = names, ((), 0)


def _listed(joints: Sequence[str]) -> str:
    return f"joint{'s' * (len(joints) > 1)} {', '.join(joints)}"
