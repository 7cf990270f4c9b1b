"""Which transport the nodes take, if the middleware is Fast DDS."""

from __future__ import annotations

import os

VARIABLE, UDP = "FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"


def without_shared_memory() -> None:
    """Take UDP unless the user has chosen; call it before `rclpy.init`.

    A process that is killed (SIGKILL) while it holds a lock of the shared memory stops all that publish to it, for ever
    (seen with Fast DDS 2.14; its issue 5469 is of the same kind). That may be the driver of a robot. Over UDP there is
    no such lock, and a node that reads 500 messages a second takes a tenth more processor time, 1 % of a core. With
    ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, ROS adds the shared memory whatever is chosen here.
    """
    os.environ.setdefault(VARIABLE, UDP)
