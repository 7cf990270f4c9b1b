"""Output of the commands: results on stdout, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
import threading
from typing import Any

QUIET_S = 2.0  # what takes less is not told where stderr is no terminal ...
PACE_S = 5.0  # ... and then one line in this time


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
    """The present step on stderr: a line that is overwritten on a terminal, else a line from time to time.

    What takes less than `QUIET_S` says nothing where stderr is no terminal.
    """

    def __enter__(self) -> Progress:
        self._live = sys.stderr.isatty()
        self._text, self._told = "", ""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._tell_now_and_then, daemon=True)
        if not self._live:
            self._thread.start()
        return self

    def __call__(self, text: str) -> None:
        """Show the present step."""
        self._text = text
        if self._live:
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._live:
            self("")
        else:
            self._thread.join()

    def _tell_now_and_then(self) -> None:
        wait_s = QUIET_S
        while not self._ended.wait(wait_s):
            if self._text != self._told:
                self._told = self._text
                print(f"joint-id: {self._text}", file=sys.stderr, flush=True)
            wait_s = PACE_S
