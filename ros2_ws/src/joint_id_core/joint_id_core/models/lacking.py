"""Which option gives a model a parameter that it lacks."""

from __future__ import annotations

from dataclasses import fields, replace

from joint_id_core.errors import JointIdError
from joint_id_core.models.base import Model
from joint_id_core.models.friction import LAWS
from joint_id_core.models.options import FLAGS
from joint_id_core.models.transmission import DRIVES

CHOICES: dict[str, tuple[str | bool, ...]] = {"actuation": DRIVES, "friction": LAWS, **dict.fromkeys(FLAGS, (True,))}


def option_for(model: Model, name: str) -> str:
    """Return the option, as on the command line, with which a model has a parameter; "" if there is none."""
    for option in (f.name for f in fields(model) if f.name in CHOICES):
        for choice in CHOICES[option]:
            try:
                found = name in replace(model, **{option: choice}).parameter_names
            except JointIdError:  # options that exclude each other
                continue
            if found:
                return f"--{option.replace('_', '-')}" + ("" if choice is True else f" {choice}")
    return ""
