"""The identifiers of the joints of a robot; what goes wrong with one of them is told, and ends nothing."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple, TypeVar

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.online.others_moving import OthersMoving
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate
from joint_id_ros.sample_queue import LOST_HERE, QUEUE_S, left_out

T = TypeVar("T")


@dataclass(eq=False)
class Lane:
    """One joint, and its samples that wait for a thread.

    Attributes:
        joint: its name.
        taken_ns, newest_ns: ages of the newest sample that its identifier has taken, and of the newest that waits.
        waiting: the samples that wait.
        came: their number, with those that waited too long.
        at_work: whether a thread works for the joint.
        begun_s: when the computation began that runs; None if none does.
        identifier: None before the first samples, and after an error.
    """

    joint: str
    taken_ns: int
    newest_ns: int = 0
    waiting: SlidingWindow = field(default_factory=partial(SlidingWindow, QUEUE_S))
    came: int = 0
    at_work: bool = False
    begun_s: float | None = None
    identifier: OnlineIdentifier | None = None

    @property
    def busy(self) -> bool:
        """Whether samples wait, or a thread works with them."""
        return self.at_work or self.came > 0


class Taken(NamedTuple):
    """Samples that an identifier has taken, the age of the newest of them, and its estimate if one was due."""

    joint: str
    samples: Recording
    newest_ns: int
    estimate: Estimate | None


class JointIdentifiers:
    """One `OnlineIdentifier` per joint; several threads may work, each for another joint.

    Args:
        make: builds the identifier of a joint, given its name and first samples.
        problem: is called with the kind of a problem and a text.

    Attributes:
        left_out: number of samples left out because they waited too long for a fit of their joint.
    """

    def __init__(self, make: Callable[[str, Recording], OnlineIdentifier], problem: Callable[[str, str], None]) -> None:
        self.left_out = 0
        self._make, self._problem = make, problem
        self._lanes: dict[str, Lane] = {}
        self._lock = threading.Lock()  # for what waits, and who works
        self._others = OthersMoving()

    @property
    def busy_s(self) -> float:
        """Duration so far of the longest running computation in s; 0 if none is running."""
        begun = [lane.begun_s for lane in self._lanes.copy().values()]
        return (now := time.monotonic()) - min((at for at in begun if at is not None), default=now)

    @property
    def busy(self) -> bool:
        """Whether samples wait, or a thread works with them."""
        return any(lane.busy for lane in self._lanes.copy().values())

    def oldest_ns(self, default: int) -> int:
        """Return the newest sample that was taken by the joint that is furthest behind; without a joint the default."""
        return min((lane.taken_ns for lane in self._lanes.copy().values()), default=default)

    def behind(self, newest_ns: int) -> list[str]:
        """Return the joints that have taken no sample as new as this one."""
        return sorted(joint for joint, lane in self._lanes.copy().items() if lane.taken_ns < newest_ns)

    def clear(self) -> None:
        """Forget all joints."""
        self._lanes.clear()
        self._others = OthersMoving()

    def forget(self, joint: str) -> None:
        """Forget a joint."""
        self._lanes.pop(joint, None)

    def watch(self, recordings: Mapping[str, Recording]) -> None:
        """Take the newest samples of all joints, identified or not, before those that are get theirs."""
        self._others.take(recordings)

    def give(self, joint: str, samples: Recording, first_ns: int, newest_ns: int) -> None:
        """Take new samples of a joint, with the ages of the first and the newest one; they wait for `update`."""
        with self._lock:
            lane = self._lanes.setdefault(joint, Lane(joint, first_ns))
            lane.waiting.append(samples)
            lane.newest_ns, lane.came = newest_ns, lane.came + len(samples)

    def update(self, joint: str, took: Callable[[Taken], None]) -> None:
        """Give an identifier the samples that wait, and then those that come meanwhile; `took` is told each time.

        Nothing is done if another thread does that. Nothing is told of a joint that was forgotten meanwhile: it has
        another identifier when it returns.
        """
        lane = self._lanes.get(joint)
        with self._lock:
            if lane is None or lane.at_work:
                return
            lane.at_work = True
        try:
            while (new := self._next(lane)) is not None:
                samples, newest_ns = new
                estimate = self._guarded(lane, partial(self._updated, lane, samples))
                lane.taken_ns = newest_ns
                if self._lanes.get(joint) is lane:
                    took(Taken(joint, samples, newest_ns, estimate))
        except BaseException:
            lane.at_work = False
            raise

    def _next(self, lane: Lane) -> tuple[Recording, int] | None:
        """Return the samples that wait, and the age of the newest one; without any, no thread works for the joint.

        None for a joint that was forgotten.
        """
        with self._lock:
            waiting, count = lane.waiting, lane.came
            lane.at_work = count > 0 and self._lanes.get(lane.joint) is lane
            if not lane.at_work:
                return None
            lane.waiting, lane.came = SlidingWindow(QUEUE_S), 0
            newest_ns = lane.newest_ns
        samples = waiting.recording()
        lost = count - len(samples)
        if lost > 0:
            self.left_out += lost
            self._problem(LOST_HERE, f"joint {lane.joint}: {left_out(lost)}")
        return samples, newest_ns

    def _updated(self, lane: Lane, samples: Recording) -> Estimate | None:
        if lane.identifier is None:
            lane.identifier = self._make(lane.joint, samples)
        identifier, told = lane.identifier, self._others.told
        estimate = identifier.update(samples)
        return None if estimate is None else told(lane.joint, estimate, samples, identifier.model)

    def finish(self, joints: Collection[str]) -> None:
        """Do what the joints for which no thread works left to do at their last updates."""
        for joint in joints:
            lane = self._lanes.get(joint)
            if lane is not None and not lane.at_work and lane.identifier is not None:
                self._guarded(lane, lane.identifier.finish)

    def _guarded(self, lane: Lane, work: Callable[[], T]) -> T | None:
        """Do work for a joint; return None after an error, which is reported."""
        lane.begun_s = time.monotonic()
        try:
            return work()
        except JointIdError as error:
            self._problem("samples left out", f"joint {lane.joint}: {error}")
        except Exception as error:  # a bug must not end the thread silently
            lane.identifier = None
            self._problem("internal error", f"joint {lane.joint}: identification starts anew after {place_of(error)}")
        finally:
            lane.begun_s = None
        return None


def place_of(error: Exception) -> str:
    """Return an exception and the place that raised it, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {' '.join(str(error).split())} ({frame.filename}:{frame.lineno})"
