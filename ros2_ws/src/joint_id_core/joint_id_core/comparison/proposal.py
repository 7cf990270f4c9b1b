"""Which models a recording allows, the richest first, with the options that its motion asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from joint_id_core.comparison.gravity import CLEARLY, WITH_GRAVITY, gravity_helps
from joint_id_core.comparison.model_text import every_model
from joint_id_core.data.recording import Recording
from joint_id_core.models.options import ModelOptions


@dataclass(frozen=True)
class Proposal:
    """A model, and why it may be the right one."""

    options: ModelOptions
    why: str

    def __str__(self) -> str:
        """Return it in words."""
        return f"{self.options.model}{' with gravity' if self.options.gravity else ''}: {self.why}"


def proposals(recording: Recording, given: Mapping[str, Any]) -> list[Proposal]:
    """Return the models whose signals a recording holds, the richest first; `given` are options of the user.

    Raises:
        JointIdError: no model fits the recording, or an option has a value that is not one of the choices.
    """
    helps, found = gravity_helps(recording), []
    for name in reversed(every_model(recording)):
        measured = [n for n in recording.channels if recording.measured(n)]
        sides = " and ".join(side for side in ("motor", "link") if any(n.startswith(side) for n in measured))
        why = f"the {sides} {'are' if ' and ' in sides else 'is'} measured"
        options = dict(given)
        if helps > CLEARLY and "gravity" not in given and name in WITH_GRAVITY:
            options["gravity"] = True
            why += f", and with gravity new samples are predicted {100.0 * helps:.0f} % better"
        found.append(Proposal(ModelOptions(model=name, **options), why))
    return found
