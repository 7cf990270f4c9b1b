"""What a message of an estimate must be: at most three sentences that a person can read."""

from __future__ import annotations

import re

LONGEST = 700  # characters of a message: five lines


def readable(message: str, source: str = "") -> None:
    """Fail if a message is not readable; it may begin with the name of its `source`, written as that is."""
    sentences = re.findall(r"[^.]+(?:\.\d[^.]*)*\.", message)
    assert 1 <= len(sentences) <= 3, message
    assert re.search(r"\d{9}", message) is None, message
    assert len(message) <= LONGEST, message
    assert message[0].isupper() or message[0].isdigit() or (source and message.startswith(source)), message
    assert message.endswith(".") and ".." not in message and "\n" not in message, message
