"""The torque at the link that one unit of a recorded drive stands for, from torque constants and gear ratios."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models.per_joint import Entry

NAMES = ("N", "k_t")  # ratio of a gear, torque constant in Nm/A
Gains = Mapping[str, Mapping[str, float]]  # by joint and drive ("torque", "current"), Nm for one unit of it


@dataclass(frozen=True)
class Drive:
    """What is known of the drive of a joint: values of `NAMES`, and standard deviations of some."""

    values: Mapping[str, float] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)

    def with_entry(self, entry: Entry) -> Drive:
        """Return it with a value that the user set."""
        if entry.value is None:
            return self
        spread = {name: value for name, value in self.deviations.items() if name != entry.name}
        spread |= {} if entry.deviation is None else {entry.name: entry.deviation}
        return Drive({**self.values, entry.name: entry.value}, spread)


def gains_of(
    joints: Sequence[str], entries: Sequence[Entry], known: Callable[[str], Drive] = lambda joint: Drive()
) -> tuple[Gains, str]:
    """Return the gains of all joints, and how far the torque constants are known, in words; "" if that is not known.

    A recorded torque is taken as that at the link where a joint has no ratio.

    Args:
        joints: names of the joints.
        entries: values that the user set, for all joints or for one.
        known: gives what is known of the drive of a joint otherwise.

    Raises:
        JointIdError: an entry for another parameter or joint, or a value of zero.
    """
    for entry in entries:
        _check(entry, joints)
    gains, shares = {}, []
    for name in joints:
        drive = known(name)
        for entry in sorted(entries, key=lambda e: e.joint != ""):
            if entry.joint in ("", name):
                drive = drive.with_entry(entry)
        ratio = drive.values.get("N", 1.0)
        gains[name] = {"torque": ratio}
        if "k_t" in drive.values:
            gains[name]["current"] = ratio * drive.values["k_t"]
            shares += [drive.deviations["k_t"] / drive.values["k_t"]] if "k_t" in drive.deviations else []
    ends = sorted({f"{100.0 * share:.2g}" for share in (min(shares), max(shares))}, key=float) if shares else []
    return gains, f"{' to '.join(ends)} %" if ends else ""


def _check(entry: Entry, joints: Sequence[str]) -> None:
    if entry.name not in NAMES:
        raise JointIdError(f"set {entry.name}: of an arm, {' and '.join(NAMES)} can be set")
    if entry.joint and entry.joint not in joints:
        raise JointIdError(
            f"set {entry.joint}.{entry.name}: no such joint{close_to(entry.joint, joints)}: there are "
            f"{', '.join(joints)}"
        )
    if entry.value == 0.0:
        raise JointIdError(f"set {entry.name}=0: give a value that is not 0")
