"""Parse texts of the form NAME=VALUE, and vectors, from command lines and ROS parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable

from joint_id_core.errors import JointIdError


def texts_by_name(texts: Iterable[str], option: str) -> dict[str, str]:
    """Split texts NAME=TEXT; `option` is what the user calls the option, e.g. "--set".

    Raises:
        JointIdError: no equals sign, an empty side, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise JointIdError(f"{option} {text}: not of the form NAME=VALUE")
        if name in found:
            raise JointIdError(f"{option} {name} is given twice: give it once")
        found[name] = value
    return found


def numbers_by_name(texts: Iterable[str], option: str) -> dict[str, float]:
    """Split texts NAME=NUMBER.

    Raises:
        JointIdError: as `texts_by_name`, or a value that is not a number.
    """
    values = {}
    for name, text in texts_by_name(texts, option).items():
        try:
            values[name] = float(text)
        except ValueError:
            raise JointIdError(f"{option} {name}={text}: {text!r} is not a number, write e.g. {name}=0.5") from None
    return values


def value_and_deviation(text: str) -> tuple[float, float | None]:
    """Return the number of a text such as "0.5", and the standard deviation of one such as "0.5+-0.1" or "0.5+-20%".

    Raises:
        ValueError: it has another form, or a standard deviation that is not above zero.
    """
    number, sign, spread = (part.strip() for part in text.partition("+-"))
    value = float(number)
    if not sign:
        return value, None
    share = spread.endswith("%")
    deviation = float(spread.rstrip("% ")) * (abs(value) / 100.0 if share else 1.0)
    if not 0.0 < deviation < math.inf:
        raise ValueError(f"{spread} is no standard deviation")
    return value, deviation


def measured_by_name(texts: Iterable[str], option: str) -> tuple[dict[str, float], dict[str, float]]:
    """Split texts NAME=NUMBER and NAME=NUMBER+-SD; return the numbers and those standard deviations that are given.

    Raises:
        JointIdError: as `texts_by_name`, or a value of another form.
    """
    values, deviations = {}, {}
    for name, text in texts_by_name(texts, option).items():
        try:
            values[name], deviation = value_and_deviation(text)
        except ValueError:
            raise JointIdError(
                f"{option} {name}={text}: {text!r} is not a number, write e.g. {name}=0.5, or {name}=0.5+-0.1"
            ) from None
        if deviation is not None:
            deviations[name] = deviation
    return values, deviations


def vector(text: str, option: str) -> tuple[float, ...]:
    """Return the numbers of a text, such as "0,0,-9.81".

    Raises:
        JointIdError: a part is not a number.
    """
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise JointIdError(f"{option} {text}: give three numbers with commas between them") from None
