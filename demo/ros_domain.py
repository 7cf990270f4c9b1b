"""A ROS domain of one's own, on this computer alone."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

DOMAINS = 100  # 1 to 100: their ports are given to no other program by the system
# Fast DDS over UDP. LOCALHOST, the way of ROS to stay on the computer, adds shared memory: a process that is killed
# while it holds a lock there can stop all others.
ALONE = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # as the profile says
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("loopback.xml")),
}


@contextmanager
def own_domain() -> Iterator[int]:
    """Be on a domain that no other demo or test on this computer uses at the same time.

    The environment says so to ROS in this process, and in those that it starts. A file lock, which ends with the
    process at the latest, says that the domain is taken.
    """
    first = os.getpid()
    for number in itertools.cycle(1 + (first + k) % DOMAINS for k in range(DOMAINS)):
        with (Path(tempfile.gettempdir()) / f"joint_id_domain_{number}.lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            with patch.dict(os.environ, {"ROS_DOMAIN_ID": str(number)} | ALONE):
                yield number
            return
