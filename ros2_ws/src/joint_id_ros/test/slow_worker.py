"""A worker whose identifiers wait until they may go on."""

from __future__ import annotations

import threading
import time

import numpy as np

from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_ros.raw_messages import RawMessage, Table

PERIOD_NS = 10_000_000
MODEL = build("rigid_joint")
PATIENCE_S = 60.0


class Slow:
    """An identifier whose updates wait until they may go on."""

    def __init__(self, gate, finished):
        self.gate, self.finish, self.begun, self.batches = gate, finished, threading.Event(), []
        self.model = MODEL

    def update(self, samples):
        self.begun.set()
        assert self.gate.wait(PATIENCE_S)
        self.batches.append(samples)
        return unusable(MODEL, "slow", UnusableError(Status.NO_MOTION, "it rests"), samples)


def add(worker, first, last, names=("a",)):
    """Add samples `first` to before `last`."""
    table = Table(tuple(names), {"link_position": np.zeros((last - first, len(names)))})
    for k in range(first, last):
        worker.add(RawMessage(10**12 + k * PERIOD_NS, table, k - first))


def until(condition):
    """Wait for a condition."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)
