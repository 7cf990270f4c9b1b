"""Patterns of files: `*`, `?`, `[ab]`, `**` as in a shell; `{robot}` and `{joint}` are names that stand in a place."""

from __future__ import annotations

import re

from joint_id_core.errors import JointIdError

NAMES = ("robot", "joint")
_TOKENS = re.compile(r"\*\*/|\*\*|\*|\?|\[[^\]]+\]|\{[^}]*\}")
_MEANING = {"**/": "(?:[^/]+/)*", "**": ".*", "*": "[^/]*", "?": "[^/]"}


def is_pattern(text: str) -> bool:
    """Return whether a text stands for several files."""
    return _TOKENS.search(text) is not None


def for_glob(pattern: str) -> str:
    """Return a pattern without names, as `glob` takes it.

    Raises:
        JointIdError: a name that is not known.
    """
    for name in re.findall(r"\{([^}]*)\}", pattern):
        if name not in NAMES:
            known = " and ".join(f"{{{n}}}" for n in NAMES)
            raise JointIdError(f"{pattern}: {{{name}}} has no meaning: known are {known}")
    return re.sub(r"\{[^}]*\}", "*", pattern)


def fixed_part(pattern: str) -> str:
    """Return the folder of a pattern below which all of its files are."""
    found = _TOKENS.search(pattern)
    return pattern if found is None else pattern[: found.start()].rpartition("/")[0]


def expression(pattern: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern; its groups are the names."""
    parts, end, seen = [], 0, set()
    for token in _TOKENS.finditer(pattern):
        parts.append(re.escape(pattern[end : token.start()]))
        text, end = token[0], token.end()
        if text in _MEANING:
            parts.append(_MEANING[text])
        elif text[0] == "[":
            parts.append("[^" + text[2:] if text[1] == "!" else text)
        else:
            name = text[1:-1]
            parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>[^/]+?)")
            seen.add(name)
    return re.compile("".join(parts) + re.escape(pattern[end:]))
