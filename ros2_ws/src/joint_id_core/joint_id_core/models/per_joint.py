"""Parse settings of a model's parameter for all joints ("k_t=0.1") or for one joint ("elbow_joint.k_t=0.08")."""

from __future__ import annotations

import re
from dataclasses import dataclass

from joint_id_core.assignments import value_and_deviation
from joint_id_core.errors import JointIdError

# The name of a joint may contain dots; the name of a model's parameter does not.
_TEXT = re.compile(r"\s*(?:(?P<joint>[^=]*[^=.\s])\.)?(?P<name>[^=.\s]+)\s*(?:=(?P<value>.*))?")
_FORMS = {"set": ("NAME=VALUE", "k_t=0.1"), "fix": ("NAME or NAME=VALUE", "tau_fq=0"), "free": ("NAME", "k_2")}


@dataclass(frozen=True)
class Entry:
    """One parsed text of the ROS parameters `set`, `fix` and `free`.

    Attributes:
        joint: the joint that the text applies to; "" for all joints.
        name: parameter of the model.
        value: the given number, in the unit of the parameter; None without a number.
        deviation: its standard deviation, if one was given ("k_t=0.1+-0.01").
    """

    joint: str
    name: str
    value: float | None
    deviation: float | None = None


def parse(text: str, parameter: str) -> Entry:
    """Parse a text of the ROS `parameter` "set", "fix" or "free".

    Raises:
        JointIdError: the text has another form; the message names the parameter and the text.
    """
    found, value, deviation = _TEXT.fullmatch(text), None, None
    try:
        if found and found["value"] is not None:
            value, deviation = value_and_deviation(found["value"])
    except ValueError:
        found = None
    misplaced = (parameter == "set" and value is None) or (parameter == "free" and value is not None)
    if found is None or misplaced:
        form, example = _FORMS[parameter]
        raise JointIdError(
            f'parameter {parameter}: {text!r} is not of the form {form}, e.g. "{example}" for all joints '
            f'or "elbow_joint.{example}" for one'
        )
    return Entry(found["joint"] or "", found["name"], value, deviation)
