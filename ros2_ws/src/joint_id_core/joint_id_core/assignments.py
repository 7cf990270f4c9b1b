"""Parse texts of the form NAME=VALUE from command lines and ROS parameters."""

from __future__ import annotations

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
