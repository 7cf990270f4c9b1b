"""What a fit found, in sentences: the most useful ones first, at most three in a message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

MOST_SENTENCES = 3
MOST_NAMES = 12  # in a list; the table of the parameters holds all
FAR = 10.0  # variations that a prediction misses by, from which a number says no more than words
MOST_TIMES = 1000.0  # the same of other ratios


def sentence(text: str) -> str:
    """A clause as a sentence: with a capital letter and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "."


def message(sentences: Sequence[str]) -> str:
    """The first sentences, as many as a reader takes in at a glance."""
    return " ".join(sentences[:MOST_SENTENCES])


def listed(names: Iterable[str]) -> str:
    """Names separated by commas; of a long list the first ones and how many more there are."""
    names = list(names)
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def missed(what: str, nrmse: float) -> str:
    """By how much `what` misses its signal: `nrmse` is the rms error over the signal's standard deviation."""
    if not nrmse <= FAR:
        return f"{what} miss by far more than its variation"
    return f"{what} miss by {100.0 * nrmse:.3g} % of its variation"


def times(ratio: float) -> str:
    """A ratio in words: "3.2 times", or "more than 1000 times"."""
    return f"{ratio:.3g} times" if ratio <= MOST_TIMES else f"more than {MOST_TIMES:.0f} times"
