"""A ROS domain that no other demo or test on this machine uses at the same time."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

DOMAINS = 100  # 1 to 100: their ports are given to no other program by the system


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a free domain; a file lock, which ends with the process at the latest, says that it is taken."""
    first = os.getpid()
    for number in itertools.cycle(1 + (first + k) % DOMAINS for k in range(DOMAINS)):
        with (Path(tempfile.gettempdir()) / f"joint_id_domain_{number}.lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield number
            return
