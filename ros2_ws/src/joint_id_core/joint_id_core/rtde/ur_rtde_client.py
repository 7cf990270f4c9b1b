"""An RTDE client that uses the library ur_rtde (PyPI: ur-rtde), for comparison or for users who prefer this library.

The library keeps only the newest sample. So samples are lost on this computer: in its own reader when two packets
arrive together, and between two polls. Version 1.6.5 has more problems, which this module avoids:

- An unknown field shifts all later ones: only known fields are requested.
- The constructor waits without limit, and nothing else runs in this process meanwhile: before, `SocketClient` checks
  that the robot sends a sample.
- `reconnect` loses the rate: it is never called.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import Any

from joint_id_core.rtde.client import Request, Sample
from joint_id_core.rtde.errors import RefusedError, UnreachableError
from joint_id_core.rtde.fields import PORT
from joint_id_core.rtde.packets import Value
from joint_id_core.rtde.rates import sent_rate
from joint_id_core.rtde.socket_client import SocketClient

GETTERS = {
    "timestamp": "getTimestamp",
    "target_q": "getTargetQ",
    "target_qd": "getTargetQd",
    "target_qdd": "getTargetQdd",
    "target_current": "getTargetCurrent",
    "target_moment": "getTargetMoment",
    "actual_q": "getActualQ",
    "actual_qd": "getActualQd",
    "actual_current": "getActualCurrent",
    "joint_control_output": "getJointControlOutput",
    "joint_temperatures": "getJointTemperatures",
    "actual_joint_voltage": "getActualJointVoltage",
    "joint_mode": "getJointMode",
    "robot_mode": "getRobotMode",
    "safety_mode": "getSafetyMode",
    "robot_status_bits": "getRobotStatus",
    "safety_status_bits": "getSafetyStatusBits",
    "speed_scaling": "getSpeedScaling",
}

# After a sample no new one comes for most of a period. Faster polling than this does not reduce the losses.
_REST = 0.6  # of a period
_LOOK_EVERY_S = 1e-4


class UrRtdeClient:
    """One connection through ur_rtde; see `client.Client`. `messages` stays empty: ur_rtde does not return them."""

    def __init__(self, request: Request) -> None:
        self.version: tuple[int, ...] = ()
        self.messages: deque[str] = deque()
        self._request = request
        self._robot = f"robot {request.host}:{request.port}"
        self._check = SocketClient(request)
        self._interface: Any = None
        self._last = math.nan  # timestamp of the newest sample
        self._closed = False
        self._state = threading.Lock()  # guards _interface and _closed

    def open(self) -> None:
        """See `client.Client.open`; also check that the robot sends a sample, because ur_rtde would wait forever."""
        if self._request.port != PORT:
            raise RefusedError(f"{self._robot}: ur_rtde only knows port {PORT}: use the client socket for other ports")
        without = [name for name in self._request.fields if name not in GETTERS]
        if without:
            raise RefusedError(f"ur_rtde does not give {', '.join(without)}: use the client socket")
        _library()
        try:
            self._check.open()
            self._check.start()
            if not self._check.read(self._request.timeout):
                raise UnreachableError(f"{self._robot} sends nothing within {self._request.timeout:g} s")
            self.version = self._check.version
        finally:
            self._check.close()

    def start(self) -> None:
        """See `client.Client.start`."""
        rate = sent_rate(self._request.rate, self.version)
        try:
            interface = _library()(self._request.host, rate, list(self._request.fields))
        except RuntimeError as error:
            raise UnreachableError(f"{self._robot}: ur_rtde: {' '.join(str(error).split())}") from None
        with self._state:
            closed = self._closed
            if not closed:
                self._interface = interface
        if closed:
            _let_go(interface)
            raise self._closed_by_us()

    def read(self, timeout: float) -> list[Sample]:
        """See `client.Client.read`; at most one sample, the newest."""
        deadline = time.monotonic() + timeout
        time.sleep(min(_REST / self._request.rate, timeout))
        while True:
            interface = self._interface
            if interface is None:
                raise self._closed_by_us()
            try:
                sample = self._newest(interface)
                if sample is not None:
                    return [sample]
                if not interface.isConnected():
                    raise UnreachableError(f"{self._robot}: ur_rtde has lost the connection")
            except RuntimeError as error:
                raise UnreachableError(f"{self._robot}: ur_rtde: {error}") from None
            if time.monotonic() > deadline:
                return []
            time.sleep(_LOOK_EVERY_S)

    def close(self) -> None:
        """See `client.Client.close`; ur_rtde may take some seconds to end its connection."""
        self._check.close()
        with self._state:
            self._closed = True
            interface, self._interface = self._interface, None
        if interface is not None:
            _let_go(interface)

    def _newest(self, interface: Any) -> Sample | None:
        """Return the newest sample; None if it was returned before."""
        timestamp = interface.getTimestamp()
        while timestamp != self._last:
            received_ns = time.time_ns()
            values: dict[str, Value] = {}
            for name in self._request.fields:
                value = getattr(interface, GETTERS[name])()
                values[name] = tuple(value) if isinstance(value, list) else value
            # Every getter returns the newest value. The values are of one sample only if no other arrived meanwhile.
            before, timestamp = timestamp, interface.getTimestamp()
            if before == timestamp:
                self._last = timestamp
                return Sample(received_ns, values)
        return None

    def _closed_by_us(self) -> UnreachableError:
        return UnreachableError(f"{self._robot}: the connection is closed on this side")


def _library() -> Any:
    """Import and return the class of ur_rtde.

    Raises:
        RefusedError: the library is not installed.
    """
    try:
        from rtde_receive import RTDEReceiveInterface
    except ImportError as error:
        raise RefusedError(f"client ur_rtde: {error}: pip install ur-rtde, or use the client socket") from None
    return RTDEReceiveInterface


def _let_go(interface: Any) -> None:
    """End a connection of ur_rtde, which takes a second or more.

    This is not a daemon thread: if the process ended inside the library, it would abort.
    """
    threading.Thread(target=interface.disconnect, name="ur_rtde closing").start()
