"""Motion of three joints, and what the streaming differentiator makes of it, sample by sample."""

import itertools
from typing import NamedTuple

import numpy as np

PERIOD = 0.002


W = 2 * np.pi * np.array([1.0, 2.0, 3.5])  # one frequency a joint


def motion(time):
    position = np.sin(np.multiply.outer(time, W))
    return {
        "link_position": position,
        "motor_velocity": 101 * W * np.cos(np.multiply.outer(time, W)),
        "current": position**2,
    }


class Sample(NamedTuple):
    """All joints at one instant."""

    time: float
    channels: dict
    derived: frozenset


def one_by_one(batches):
    return [
        Sample(time, {name: values[k] for name, values in batch.channels.items()}, batch.derived)
        for batch in batches
        for k, time in enumerate(batch.times)
    ]


def stream(stream_filter, time, channels, sizes=(1, 3, 2, 40)):
    """Push the samples in batches of these sizes, over and over."""
    done, k = [], 0
    for size in itertools.cycle(sizes):
        if k >= len(time):
            return done
        rows = slice(k, k + size)
        done += one_by_one(stream_filter.push(time[rows].tolist(), {n: v[rows] for n, v in channels.items()}))
        k += size


def column(samples, name, joint=0):
    return np.array([s.channels[name][joint] for s in samples])


def times(samples):
    return np.array([s.time for s in samples])


def jittered(n, seed, holes=0.05, jitter=1e-4):
    rng = np.random.default_rng(seed)
    keep = rng.random(n) >= holes
    return (np.arange(n) * PERIOD + rng.uniform(-jitter, jitter, n))[keep]
