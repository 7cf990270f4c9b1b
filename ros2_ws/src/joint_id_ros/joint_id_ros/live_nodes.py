"""Nodes of a live page: their newest diagnostics."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

SILENT_S = 5.0  # without diagnostics, from which a node counts as gone
GONE_S = 60.0  # from which it is left out


class LiveNodes:
    """Keeps the newest status of every node."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, DiagnosticStatus]] = {}

    def put(self, message: DiagnosticArray) -> None:
        """Take diagnostics."""
        now = time.monotonic()
        self._heard |= {status.name: (now, status) for status in message.status}

    def rows(self) -> list[dict[str, object]]:
        """Return the rows of the page."""
        now = time.monotonic()
        self._heard = {name: (at, s) for name, (at, s) in self._heard.items() if now - at < GONE_S}
        return [_row(name, now - at, status) for name, (at, status) in sorted(self._heard.items())]


def _row(name: str, age_s: float, status: DiagnosticStatus) -> dict[str, object]:
    silent = age_s > SILENT_S
    return {
        "name": name,
        "level": int.from_bytes(DiagnosticStatus.STALE if silent else status.level, "little"),
        "message": f"silent for {age_s:.0f} s" if silent else status.message,
        "values": [[v.key, v.value] for v in status.values],
    }
