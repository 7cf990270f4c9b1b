"""Which joints the samples name, and for how long none of them did."""

from __future__ import annotations

from collections.abc import Collection

from joint_id_core.data.instants import NANO
from joint_id_ros.callbacks import Callbacks
from joint_id_ros.silence import Silence

GONE_S = 2.0  # a joint that the samples have not named for so long is not identified any more
PAUSE_S = 30.0  # without any samples, up to which the identifiers go on as after a gap


class Presence:
    """Finds the joints that are gone, and tells why.

    Args:
        callbacks: callbacks for problems and joints that are silent, and the clock.
        known: joints that were published before the first sample; those not in the samples are gone, too.
    """

    def __init__(self, callbacks: Callbacks, known: Collection[str]) -> None:
        self._callbacks, self._known = callbacks, tuple(known)
        self._named_ns: dict[str, int] = {}  # age of the newest sample in which a joint was named
        self._silence, self._silent = Silence(callbacks.now_s), False

    def begin(self, first_ns: int) -> None:
        """Begin with the first sample of a run, which has this age."""
        self._named_ns = dict.fromkeys(self._known, first_ns)

    def end(self) -> None:
        """End a run: what was published before it is not expected any more."""
        self._named_ns, self._known = {}, ()

    def named(self, joints: Collection[str], newest_ns: int) -> list[str]:
        """Take the joints of new samples; return those that were not named for too long, which are then forgotten."""
        self._named_ns |= dict.fromkeys(joints, newest_ns)
        gone = [j for j, named_ns in self._named_ns.items() if newest_ns - named_ns > GONE_S * NANO]
        for joint in gone:
            self._callbacks.problem("joint gone", f"joint {joint} is not in joint_samples any more: it is left out")
            del self._named_ns[joint]
        return gone

    def looked(self, came: bool) -> list[str]:
        """Tell once that no samples come, given whether some `came`; after a longer pause return all joints as gone."""
        silent_s = self._silence.look(came)
        joints, before, self._silent = list(self._named_ns), self._silent, silent_s > GONE_S
        if self._silent and not before and joints:
            text = f"no joint_samples for {GONE_S:.0f} s: until they come again, no estimate of {', '.join(joints)}"
            self._callbacks.problem("no samples", text)
            for joint in joints:
                self._callbacks.silent(joint)
        if silent_s <= PAUSE_S:
            return []
        self._named_ns.clear()
        return joints
