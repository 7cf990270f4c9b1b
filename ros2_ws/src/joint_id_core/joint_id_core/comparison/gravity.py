"""Whether a recording shows gravity, which a user who names no model need not know."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.missing import GRAVITY
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import MODELS
from joint_id_core.models.options import DRIVES
from joint_id_core.models.rigid_joint import RigidJoint

CLEARLY = 0.2  # share of the error of new samples that gravity takes away; a flexible gear may look like 6 %
# Travel in rad that shows a load as that of gravity: over less it looks like a spring with a force of any size, as of a
# cable, or friction of a linear axis (EMPS: an offset of 370 N where 3 are).
TRAVEL = 0.3
WITH_GRAVITY = tuple(name for name, model in MODELS.items() if "gravity" in model.__dataclass_fields__)


def gravity_helps(recording: Recording) -> float:
    """Return the share of the error of new samples that gravity takes away from inverse dynamics of a rigid joint.

    0 without the signals that it needs, and if the joint moves little.
    """
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy, as the next
    from joint_id_core.estimators.shared.long_record import fitted_part

    drive = next((d for d in DRIVES if recording.measured(d)), None)
    if drive is None or not recording.measured("link_position"):
        return 0.0
    position = recording["link_position"]
    known = position[np.isfinite(position)]
    if not len(known) or not np.ptp(known) > TRAVEL:
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
