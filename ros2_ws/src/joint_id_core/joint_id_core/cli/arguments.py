"""What several commands have in common: NAME=VALUE arguments, results on stdout, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable
from typing import Any

from joint_id_core.errors import JointIdError


def pairs(texts: Iterable[str], option: str) -> dict[str, str]:
    """Split NAME=TEXT arguments.

    Raises:
        JointIdError: no equals sign, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise JointIdError(f"{option} {text}: write {option} NAME=VALUE")
        if name in found:
            raise JointIdError(f"{option} {name} is given twice: give it once")
        found[name] = value
    return found


def numbers(texts: Iterable[str], option: str) -> dict[str, float]:
    """Split NAME=VALUE arguments whose values are numbers.

    Raises:
        JointIdError: as `pairs`, or a value that is not a number.
    """
    values = {}
    for name, text in pairs(texts, option).items():
        try:
            values[name] = float(text)
        except ValueError:
            raise JointIdError(
                f"{option} {name}={text}: {text!r} is not a number, write e.g. {option} {name}=0.5"
            ) from None
    return values


def print_json(result: Any) -> None:
    """Write one JSON document to stdout; what is not a number becomes null, as JSON has no NaN."""
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
    """One line on stderr that is written over, and only when a person watches."""

    def __enter__(self) -> Progress:
        self._live = sys.stderr.isatty()
        return self

    def __call__(self, text: str) -> None:
        """Show what is being done now."""
        if self._live:
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        self("")
