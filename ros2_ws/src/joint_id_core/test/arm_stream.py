"""Samples of all joints of an arm as a stream, and the load that is added to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.arm.online_load import OnlineLoad
from joint_id_core.data.recording import Recording

BATCH = 5  # samples that a filter node reads at once
ORIGIN_NS = 1_000_000_000_000_000_000


def batches(recordings: Mapping[str, Recording], size: int = BATCH) -> Iterator[AlignedSamples]:
    """Recordings of all joints at the same instants, as the aligner gives them."""
    joints, first = tuple(recordings), next(iter(recordings.values()))
    channels = {name: np.column_stack([r[name] for r in recordings.values()]) for name in first.channels}
    instants_ns = [ORIGIN_NS + round(1e9 * time) for time in first.time.tolist()]
    for k in range(0, len(first), size):
        part = {name: values[k : k + size] for name, values in channels.items()}
        yield AlignedSamples(instants_ns[k : k + size], joints, part, frozenset())


def passed(load: OnlineLoad, samples: Iterable[AlignedSamples], to_the_end: bool = True) -> list[AlignedSamples]:
    """What comes out of it."""
    done = [one for part in samples for one in load.add(part)]
    return done + load.release() if to_the_end else done


def as_recordings(samples: Iterable[AlignedSamples]) -> dict[str, Recording]:
    """Samples of the same joints and channels as recordings, by joint."""
    parts = list(samples)
    time = np.array([(ns - ORIGIN_NS) * 1e-9 for part in parts for ns in part.instants_ns])
    table = {name: np.concatenate([part.channels[name] for part in parts]) for name in parts[0].channels}
    return {
        joint: Recording(time, {n: v[:, j] for n, v in table.items()}, parts[0].derived, "joint_samples", joint)
        for j, joint in enumerate(parts[0].joints)
    }
