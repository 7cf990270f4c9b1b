"""Column names that people write: "Time (ms)", "Link position [deg]", "motor velocity (rpm)"."""

from __future__ import annotations

import math
import re

from joint_id_core.data.signals import CHANNELS

TIME = "time_s"
TIMES = ("time", "t", "timestamp", TIME)
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
WITH_UNIT = re.compile(r"(.*?)\s*[(\[]\s*(.*?)\s*[)\]]")


def understood(column: str) -> tuple[str, float] | None:
    """Return the target (`time_s` or a channel) of a column and the factor that makes SI units of it.

    None if the name is not one of a channel, in other letters or with spaces, or if its unit is not one of its kind.
    """
    matched = WITH_UNIT.fullmatch(column.strip())
    name, unit = matched.groups() if matched else (column, "")
    name = re.sub(r"[\s.-]+", "_", name.strip().lower())
    for ending in ("_deg", "_ms", "_rad", "_rpm", "_nm"):
        if not unit and name.endswith(ending):
            name, unit = name.removesuffix(ending), ending[1:]
    target = TIME if name in TIMES else name
    if target != TIME and target not in CHANNELS:
        return None
    kind = "s" if target == TIME else CHANNELS[target].unit
    factor = UNITS.get(kind, {}).get(unit.lower()) if unit else 1.0
    return None if factor is None else (target, factor)
