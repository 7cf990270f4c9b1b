"""Texts of a fit: findings as sentences, the most useful first, at most three in a message."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

MOST_NAMES = 12  # in one list; the table of the parameters has all of them
FAR = 10.0  # nrmse above which a message gives words in place of the number
MOST_TIMES = 1000.0  # the same for other ratios


def sentence(text: str) -> str:
    """Return a clause as a sentence, with a capital letter and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "."


def listed(names: Iterable[str]) -> str:
    """Return names separated by commas; a long list is cut and ends with the number of names left out."""
    names = list(names)
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def not_shown(names: Iterable[str]) -> str:
    """Return that a motion does not show parameters, as a clause."""
    return f"this motion does not show {listed(names)}"


def without_shown(notes: Sequence[str], names: Collection[str]) -> tuple[str, ...]:
    """Return notes in which none says that the motion does not show one of these parameters."""
    begin, kept = sentence(not_shown([""])).removesuffix("."), list[str]()
    for note in notes:
        if not note.startswith(begin):
            kept.append(note)
        elif left := [n for n in note.removeprefix(begin).removesuffix(".").split(", ") if n not in names]:
            kept.append(sentence(not_shown(left)))
    return tuple(kept)


def missed(what: str, nrmse: float) -> str:
    """Say by how much `what` misses its signal; `nrmse` is the rms error over the signal's standard deviation."""
    if not nrmse <= FAR:
        return f"{what} miss by far more than its variation"
    return f"{what} miss by {100.0 * nrmse:.3g} % of its variation"


def of_halves(values: Iterable[tuple[str, float, float]]) -> str:
    """Say that the halves of a recording ask for other values, from name, value in the first half and in the second."""
    parts = [
        f"{name} about {first} in the first half and {second} in the second"
        for name, first, second in ((name, *apart(*pair)) for name, *pair in values)
    ]
    return (
        f"the halves of the recording ask for different values, {'; '.join(parts)}, which the standard deviations "
        "contain: the joint or its load changed, or something acts that the model lacks; fit parts (--start, --end)"
    )


def apart(first: float, second: float) -> tuple[str, str]:
    """Return two numbers with as many digits as tell them apart, three or more."""
    for digits in range(3, 17):
        texts = f"{first:.{digits}g}", f"{second:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def times(ratio: float) -> str:
    """Return a ratio in words: "3.2 times", or "more than 1000 times"."""
    if ratio > MOST_TIMES:
        return f"more than {MOST_TIMES:.0f} times"
    return f"{ratio:.3g} times" if ratio < 99.95 else f"{ratio:.0f} times"  # not 1e+03
