"""Nodes of a live page: their newest diagnostics."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

SILENT_S = 5.0  # without diagnostics, from which a node counts as gone
GONE_S = 60.0  # from which it is left out


class LiveNodes:
    """Keeps the newest status of every node of a namespace."""

    def __init__(self, namespace: str = "/", kept: str = "") -> None:
        """Begin without nodes; those of other namespaces, robots of their own, are left out.

        The node whose name is `kept` stays in the rows, however long it is silent.
        """
        self._below = f"{namespace.rstrip('/')}/"
        self._kept = f"{self._below}{kept}"
        self._heard: dict[str, tuple[float, DiagnosticStatus]] = {}

    def put(self, message: DiagnosticArray) -> None:
        """Take diagnostics."""
        now = time.monotonic()
        self._heard |= {s.name: (now, s) for s in message.status if s.name.startswith(self._below)}

    def silent(self, name: str) -> bool:
        """Whether a node that reported once does not report any more."""
        return self._silent_s(name) > SILENT_S

    @property
    def complaints(self) -> list[str]:
        """That the kept node is silent, if it is."""
        return [f"{self._kept} is silent for {self._silent_s(self._kept):.0f} s"] if self.silent(self._kept) else []

    def _silent_s(self, name: str) -> float:
        return time.monotonic() - self._heard[name][0] if name in self._heard else 0.0

    def worst(self, below: str) -> tuple[int, str]:
        """Return the worst level of the nodes whose names begin with `below`, and what these say."""
        now, found = time.monotonic(), []
        for name, (at, status) in self._heard.items():
            if name.startswith(below) and now - at < GONE_S:
                found.append((_level(now - at, status), f"{name.removeprefix(below)}: {_says(now - at, status)}"))
        level = max((level for level, _ in found), default=0)
        return level, "; ".join(sorted(text for own, text in found if own == level)) if level else ""

    def rows(self) -> list[dict[str, object]]:
        """Return the rows of the page."""
        now = time.monotonic()
        self._heard = {n: (at, s) for n, (at, s) in self._heard.items() if now - at < GONE_S or n == self._kept}
        return [_row(name, now - at, status) for name, (at, status) in sorted(self._heard.items())]


def _row(name: str, age_s: float, status: DiagnosticStatus) -> dict[str, object]:
    return {
        "name": name,
        "level": _level(age_s, status),
        "message": _says(age_s, status),
        "values": [[v.key, v.value] for v in status.values],
    }


def _level(age_s: float, status: DiagnosticStatus) -> int:
    return int.from_bytes(DiagnosticStatus.STALE if age_s > SILENT_S else status.level, "little")


def _says(age_s: float, status: DiagnosticStatus) -> str:
    return f"silent for {age_s:.0f} s" if age_s > SILENT_S else str(status.message)
