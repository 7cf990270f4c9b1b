"""Identification of the dynamics of collaborative robot joints, without ROS.

    import joint_id_core as jid

    recording = jid.read("motion.csv")
    estimate = jid.fit(jid.build("harmonic_drive"), recording)
    print(estimate)

Names are loaded when they are first used, so the import itself takes almost no time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from joint_id_core.arm.description import Description as Description
    from joint_id_core.arm.fit import fit_arm as fit_arm
    from joint_id_core.arm.loaded import loaded as loaded
    from joint_id_core.comparison.comparing import compare as compare
    from joint_id_core.data.recording import Recording as Recording
    from joint_id_core.design.arm_design import design_arm as design_arm
    from joint_id_core.design.joint import design_joint as design_joint
    from joint_id_core.design.limit_files import read_limits as read_limits
    from joint_id_core.errors import JointIdError as JointIdError
    from joint_id_core.estimators import HPinn as HPinn
    from joint_id_core.estimators import Innovations as Innovations
    from joint_id_core.estimators import ParameterSettings as ParameterSettings
    from joint_id_core.estimators import Regression as Regression
    from joint_id_core.estimators import fit as fit
    from joint_id_core.estimators import fit_several as fit_several
    from joint_id_core.estimators.hpinn.many import train_many as train_many
    from joint_id_core.estimators.many.bootstrap import bootstrap as bootstrap
    from joint_id_core.estimators.many.fleet import fit_fleet as fit_fleet
    from joint_id_core.estimators.many.starts import many_starts as many_starts
    from joint_id_core.formats import read as read
    from joint_id_core.formats import write as write
    from joint_id_core.models import Model as Model
    from joint_id_core.models import build as build
    from joint_id_core.online import OnlineIdentifier as OnlineIdentifier
    from joint_id_core.online import OnlineOptions as OnlineOptions
    from joint_id_core.results import Estimate as Estimate
    from joint_id_core.results import Status as Status
    from joint_id_core.results import Verdict as Verdict
    from joint_id_core.simulation import simulate as simulate
    from joint_id_core.simulation import simulate_motion as simulate_motion
    from joint_id_core.validation import held_out as held_out

_ROOMS = {
    "Description": "arm.description",
    "HPinn": "estimators",
    "Regression": "estimators",
    "fit_several": "estimators",
    "Innovations": "estimators",
    "JointIdError": "errors",
    "Model": "models",
    "OnlineIdentifier": "online",
    "OnlineOptions": "online",
    "ParameterSettings": "estimators",
    "Estimate": "results",
    "Recording": "data.recording",
    "Status": "results",
    "Verdict": "results",
    "bootstrap": "estimators.many.bootstrap",
    "build": "models",
    "compare": "comparison.comparing",
    "design_arm": "design.arm_design",
    "design_joint": "design.joint",
    "fit": "estimators",
    "fit_arm": "arm.fit",
    "fit_fleet": "estimators.many.fleet",
    "held_out": "validation",
    "loaded": "arm.loaded",
    "many_starts": "estimators.many.starts",
    "read": "formats",
    "read_limits": "design.limit_files",
    "simulate": "simulation",
    "simulate_motion": "simulation",
    "train_many": "estimators.hpinn.many",
    "write": "formats",
}

__all__ = sorted(_ROOMS)  # a list, made from the table above


def __getattr__(name: str) -> object:
    """Load a public name from its subpackage when it is first used; `__version__` is that of the package."""
    if name == "__version__":
        from importlib.metadata import version  # takes longer than all of this

        return version("joint-id-core")
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}: it has {', '.join(__all__)}")
    value = getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
