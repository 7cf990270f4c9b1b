"""The client of ur_rtde: placeholder until it is written."""

from __future__ import annotations

from joint_id_core.rtde.client import Request
from joint_id_core.rtde.socket_client import SocketClient


class UrRtdeClient(SocketClient):
    """x."""

    def __init__(self, request: Request) -> None:
        super().__init__(request)
