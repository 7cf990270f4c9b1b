"""Output of the commands: results on stdout, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
from typing import Any


def print_json(result: Any) -> None:
    """Write one JSON document to stdout, with null for NaN and infinity, which JSON does not have."""
    print(json.dumps(_plain(result), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


class Progress:
    """One line on stderr that is overwritten; it is shown only if stderr is a terminal."""

    def __enter__(self) -> Progress:
        self._live = sys.stderr.isatty()
        return self

    def __call__(self, text: str) -> None:
        """Show the present step."""
        if self._live:
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        self("")
