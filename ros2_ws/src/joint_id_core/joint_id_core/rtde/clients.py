"""The RTDE clients by name."""

from __future__ import annotations

from collections.abc import Callable

from joint_id_core.rtde.client import Client, Request
from joint_id_core.rtde.socket_client import SocketClient
from joint_id_core.rtde.ur_rtde_client import UrRtdeClient

CLIENTS: dict[str, Callable[[Request], Client]] = {"socket": SocketClient, "ur_rtde": UrRtdeClient}
