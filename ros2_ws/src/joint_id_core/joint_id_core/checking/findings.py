"""All checks of a recording."""

from __future__ import annotations

from collections.abc import Collection

from joint_id_core.checking.burst import bursts
from joint_id_core.checking.circuit import circuit
from joint_id_core.checking.clipping import cut_off
from joint_id_core.checking.coarse import COARSE, coarse
from joint_id_core.checking.command import unfollowed
from joint_id_core.checking.constant import constant_channels
from joint_id_core.checking.direction import directions
from joint_id_core.checking.finding import SAMPLES, Finding
from joint_id_core.checking.frozen import frozen
from joint_id_core.checking.jumps import jumps
from joint_id_core.checking.rate import low_rate
from joint_id_core.checking.repeats import repeated
from joint_id_core.checking.rows import outliers, zeros
from joint_id_core.checking.stamps import STAMPS, uneven_stamps
from joint_id_core.checking.standing import slower_source, standing
from joint_id_core.checking.swapped import swapped
from joint_id_core.checking.twist import twist_offset
from joint_id_core.checking.units import drive_units, position_units, time_units, too_large
from joint_id_core.checking.velocity import UNLIKE, velocities
from joint_id_core.data.recording import Recording

LEAST = 50  # samples; fewer show nothing
CHECKS = (  # what explains other findings comes before them
    time_units, position_units, drive_units, swapped, slower_source, constant_channels, velocities,
    low_rate, uneven_stamps, outliers, repeated, zeros, jumps, frozen, cut_off, standing, twist_offset, directions,
    unfollowed, circuit, bursts, coarse,
)  # fmt: skip


def findings(recording: Recording) -> tuple[Finding, ...]:
    """Return what is doubtful about a recording, fatal findings first. It takes some 20 ms for 10,000 samples."""
    if len(recording) < LEAST:
        return ()
    found = list(too_large(recording))
    if found:  # their numbers would go beyond all others in what follows
        large = {name for finding in found for name in finding.channels}
        rest = {name: values for name, values in recording.channels.items() if name not in large}
        recording = recording.trusted(recording.time, rest, recording.derived)
    found += [finding for check in CHECKS for finding in check(recording)]
    faulty = {name for f in found if f.about in (SAMPLES, COARSE) for name in f.channels}
    stamped = any(f.about == STAMPS for f in found)  # then no rate is known
    unlike = [f for f in found if f.about == UNLIKE]
    explained = {name for f in found if f not in unlike for name in f.channels}  # such as a sensor that froze
    found = [f for f in found if f not in unlike or not f.concerns(explained)]
    told = [f for f in found if not _follows(f, faulty) and not (stamped and f.about == "rate")]
    return tuple(sorted(told, key=lambda f: not f.fatal))


def _follows(finding: Finding, faulty: Collection[str]) -> bool:
    """Return whether a finding may only follow from faulty or coarse samples of channels."""
    if finding.about in ("twist", "drift"):
        return any(name in faulty for name in finding.channels)
    return finding.about == "rate" and all(name in faulty for name in finding.channels)
