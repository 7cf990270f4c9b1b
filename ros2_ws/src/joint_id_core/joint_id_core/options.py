"""Options of a component as one described dataclass. ROS parameters, CLI options and docs are generated from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import Field, field, fields
from numbers import Integral, Real
from typing import Any

from joint_id_core.errors import JointIdError, close_to

Progress = Callable[[str], None]  # called with a line of text from time to time during a long computation


def option(
    default: Any,
    description: str,
    unit: str = "",
    lower: float | None = None,
    upper: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Return a dataclass field with description, unit and range as metadata."""
    meta = {"description": description, "unit": unit, "lower": lower, "upper": upper, "choices": choices}
    if isinstance(default, dict):
        return field(default_factory=lambda: dict(default), metadata=meta)
    return field(default=default, metadata=meta)


def same_option(options: type, name: str) -> Any:
    """Return a dataclass field with the default and metadata of the option `name` of another dataclass."""
    f = next(f for f in fields(options) if f.name == name)
    return field(default=f.default, metadata=f.metadata)


def check(options: Any) -> None:
    """Check every field of an options dataclass against its range; call it in `__post_init__`.

    Raises:
        JointIdError: as `check_value`.
    """
    for f in fields(options):
        check_value(f, getattr(options, f.name))


def check_value(option: Field[Any], value: Any) -> None:
    """Check a value of one option against its type, range or choices; for a tuple, check every element.

    Raises:
        JointIdError: the value is not allowed; the message names the option, the value and the allowed ones.
    """
    meta = option.metadata
    for v in value if isinstance(value, tuple) else (value,):
        if meta.get("choices") and v not in meta["choices"]:
            close = close_to(str(v), meta["choices"])
            raise JointIdError(f"option {option.name} = {v!r}{close}: choose one of {names(meta['choices'])}")
        lower, upper = meta.get("lower"), meta.get("upper")
        kind, what = (Integral, "whole number") if type(option.default) is int else (Real, "number")
        if (lower, upper) != (None, None) and (isinstance(v, bool) or not isinstance(v, kind)):
            raise JointIdError(f"option {option.name} = {v!r}: give a {what}")
        if (lower is not None and not v >= lower) or (upper is not None and not v <= upper):
            span = f"[{'-inf' if lower is None else lower}, {'inf' if upper is None else upper}]"
            raise JointIdError(f"option {option.name} = {v} {meta['unit']}: must be in {span}")


def names(choices: tuple[str, ...]) -> str:
    """Return choices as text, as a user types them."""
    return ", ".join(choice or '""' for choice in choices)
