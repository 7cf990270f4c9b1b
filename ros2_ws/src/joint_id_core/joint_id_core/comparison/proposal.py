"""Which models a recording allows, the richest first, with the options that its motion asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from joint_id_core.comparison.model_text import every_model
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.missing import GRAVITY
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models.options import DRIVES, ModelOptions
from joint_id_core.models.rigid_joint import RigidJoint

CLEARLY = 0.2  # share of the error of new samples that gravity takes away; a flexible gear may look like 6 %


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
        if helps > CLEARLY and "gravity" not in given and name != "dc_motor":
            options["gravity"] = True
            why += f", and with gravity new samples are predicted {100.0 * helps:.0f} % better"
        found.append(Proposal(ModelOptions(model=name, **options), why))
    return found


def gravity_helps(recording: Recording) -> float:
    """Return the share of the error of new samples that gravity takes away from inverse dynamics of a rigid joint.

    0 without the signals that it needs.
    """
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy, as the next
    from joint_id_core.estimators.shared.long_record import fitted_part

    drive = next((d for d in DRIVES if recording.measured(d)), None)
    if drive is None or not recording.measured("link_position"):
        return 0.0
    names = [n for n in ("link_position", "link_velocity") if recording.measured(n)]
    names += [n for n in ("external_torque",) if n in recording]  # it may be computed
    channels = {n: recording[n] for n in names} | {"torque": recording[drive]}
    seen = Recording(recording.time, channels, source=recording.source)
    rigid = RigidJoint()
    try:
        return regressed(rigid, fitted_part(rigid, seen), ParameterSettings(), Regression())[0].helps[GRAVITY]
    except JointIdError:
        return 0.0
