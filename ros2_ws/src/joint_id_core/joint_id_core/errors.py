"""The one exception type of this library, and words for its messages."""

from __future__ import annotations

from collections.abc import Iterable


class JointIdError(ValueError):
    """Misuse or unusable data.

    The message is one line that says what was wrong, where, and what to do. A poor result raises no exception: the
    status of its `Estimate` says so.
    """


def close_to(name: object, known: Iterable[str]) -> str:
    """Return " (did you mean k_1?)" if one of the known names is close to what was given as one, else an empty text."""
    from difflib import get_close_matches  # only when something is wrong

    by_lower = {one.lower(): one for one in known if one}
    found = get_close_matches(str(name).lower(), by_lower, n=1, cutoff=0.6)
    return f" (did you mean {by_lower[found[0]]}?)" if found else ""
