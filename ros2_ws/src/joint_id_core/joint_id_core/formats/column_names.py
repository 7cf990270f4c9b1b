"""Column names that people write: "Time (ms)", "Link position [deg]", "motor velocity (rpm)"."""

from __future__ import annotations

import math
import re

from joint_id_core.data.signals import CHANNELS

TIME = "time_s"
TIMES = ("time", "t", "timestamp", "__time", TIME)  # `__time` of PlotJuggler
DEGREE = math.pi / 180.0
# By SI unit: what is written for it and for others of its kind, with the factor that makes SI of it.
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "°": DEGREE, "m": 1.0, "mm": 1e-3},
    "rad/s": {"rad/s": 1.0, "deg/s": DEGREE, "°/s": DEGREE, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3},
    "rad/s^2": {"rad/s^2": 1.0, "rad/s2": 1.0, "deg/s^2": DEGREE, "deg/s2": DEGREE, "m/s^2": 1.0, "m/s2": 1.0},
    "A": {"a": 1.0, "ma": 1e-3},
    "V": {"v": 1.0, "mv": 1e-3},
    "Nm": {"nm": 1.0, "n m": 1.0, "n*m": 1.0, "mnm": 1e-3, "knm": 1e3, "n": 1.0, "kn": 1e3},
    "deg C": {"deg c": 1.0, "degc": 1.0, "°c": 1.0, "c": 1.0},
}
WITH_UNIT = re.compile(r"(.*?)\s*[(\[]\s*(\D.*?)\s*[)\]]")  # a number there is no unit: `position[0]`


ENDINGS = ("_deg", "_rad", "_rpm", "_nm", "_s", "_ms", "_us", "_ns")  # units that are written so


def understood(column: str) -> tuple[str, float] | None:
    """Return the target (`time_s` or a channel) of a column and the factor that makes SI units of it.

    None if the name is not one of a channel, in other letters or with spaces, or if its unit is not one of its kind.
    """
    name, unit = parts(column)
    target = TIME if name in TIMES else name
    factor = factor_of(target, unit)
    return None if factor is None else (target, factor)


def parts(column: str) -> tuple[str, str]:
    """Return the name in a column's name, in small letters and with "_" for spaces, and its unit, "" for none."""
    name, unit = without_unit(column)
    return re.sub(r"[\s.-]+", "_", name.lower()), unit


def without_unit(column: str) -> tuple[str, str]:
    """Return a column's name without its unit, and the unit, "" for none."""
    matched = WITH_UNIT.fullmatch(column.strip())
    name, unit = matched.groups() if matched else (column, "")
    name = name.strip()
    for ending in ENDINGS:
        if not unit and re.sub(r"[\s.-]+", "_", name.lower()).endswith(ending):
            name, unit = name[: -len(ending)], ending[1:]
    return name, unit


def unit_of(target: str) -> str:
    """Return the SI unit of a target, "" if it is none."""
    if target == TIME:
        return "s"
    return CHANNELS[target].unit if target in CHANNELS else ""


def factor_of(target: str, unit: str) -> float | None:
    """Return the factor that makes SI of a unit, 1 for none; None if it is not one of the target's kind."""
    kind = unit_of(target)
    if not kind:
        return None
    return UNITS.get(kind, {}).get(unit.lower()) if unit else 1.0


def is_unit(text: str) -> bool:
    """Return whether a text is a unit that is known."""
    return any(text.lower() in known for known in UNITS.values())


def is_si(column: str, unit: str) -> bool:
    """Return whether a unit is the SI unit of what a column's name says."""
    name, own = parts(column)
    return not own and factor_of(TIME if name in TIMES else name, unit) == 1.0
