"""A ROS domain of its own for each test that takes part in one, and a worker with slow identifiers."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from ros_domain import own_domain

from joint_id_ros.callbacks import Callbacks
from joint_id_ros.worker import Worker

from .slow_worker import Slow


@pytest.fixture
def domain() -> Iterator[int]:
    """The test is on this domain, and so is every process that it starts."""
    with own_domain() as number:
        yield number


@pytest.fixture
def working(request):
    """A worker with slow identifiers, and all that it calls back; the test's parameter says whether for a recording."""
    gate, told, made = threading.Event(), [], {}
    stuck = threading.Event()

    def make(checks, joint, samples):
        made[joint] = Slow(stuck if joint == "stuck" else gate, lambda: told.append(("finished", joint)))
        return made[joint]

    callbacks = Callbacks(
        lambda joint, estimate, origin_ns: told.append(("estimated", joint)),
        lambda: told.append(("published", "")),
        lambda joint: told.append(("gone", joint)),
        lambda joint: told.append(("silent", joint)),
        lambda kind, text: told.append((kind, text)),
    )
    worker = Worker(make, (), (), callbacks, hop_s=0.5, recorded=getattr(request, "param", False))
    yield worker, gate, told, made
    gate.set()
    stuck.set()
    worker.stop()
