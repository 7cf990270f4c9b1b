"""The identifiers of the joints of a robot; what goes wrong with one of them is told, and ends nothing."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from typing import TypeVar

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.online.others_moving import OthersMoving
from joint_id_core.results.estimate import Estimate

T = TypeVar("T")


class JointIdentifiers:
    """One `OnlineIdentifier` per joint; several threads may work, each with another joint.

    Args:
        make: builds the identifier of a joint, given its name and first samples.
        problem: is called with the kind of a problem and a text.
    """

    def __init__(self, make: Callable[[str, Recording], OnlineIdentifier], problem: Callable[[str, str], None]) -> None:
        self._make, self._problem = make, problem
        self._identifiers: dict[str, OnlineIdentifier] = {}
        self._begun: dict[str, float] = {}
        self._others = OthersMoving()

    @property
    def busy_s(self) -> float:
        """Duration so far of the longest running computation in s; 0 if none is running."""
        return (now := time.monotonic()) - min(self._begun.copy().values(), default=now)

    def clear(self) -> None:
        """Forget all joints."""
        self._identifiers.clear()
        self._others = OthersMoving()

    def forget(self, joint: str) -> None:
        """Forget a joint."""
        self._identifiers.pop(joint, None)

    def watch(self, recordings: Mapping[str, Recording]) -> None:
        """Take the newest samples of all joints, identified or not, before those that are get theirs."""
        self._others.take(recordings)

    def update(self, joint: str, recording: Recording) -> Estimate | None:
        """Give a joint new samples; return its estimate if one is due."""

        def updated() -> Estimate | None:
            if joint not in self._identifiers:
                self._identifiers[joint] = self._make(joint, recording)
            identifier = self._identifiers[joint]
            estimate = identifier.update(recording)
            told = self._others.told
            return None if estimate is None else told(joint, estimate, recording, identifier.model)

        return self._guarded(joint, updated)

    def finish(self, joint: str) -> None:
        """Do what a joint left to do at its last update."""
        identifier = self._identifiers.get(joint)
        if identifier is not None:
            self._guarded(joint, identifier.finish)

    def _guarded(self, joint: str, work: Callable[[], T]) -> T | None:
        """Do work for a joint; return None after an error, which is reported."""
        self._begun[joint] = time.monotonic()
        try:
            return work()
        except JointIdError as error:
            self._problem("samples left out", f"joint {joint}: {error}")
        except Exception as error:  # a bug must not end the thread silently
            self.forget(joint)
            self._problem("internal error", f"joint {joint}: identification starts anew after {place_of(error)}")
        finally:
            self._begun.pop(joint, None)
        return None


def place_of(error: Exception) -> str:
    """Return an exception and the place that raised it, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {' '.join(str(error).split())} ({frame.filename}:{frame.lineno})"
