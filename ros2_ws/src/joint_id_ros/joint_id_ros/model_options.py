"""The ROS parameters that say what the identifier identifies."""

from __future__ import annotations

from dataclasses import dataclass, fields

from joint_id_core.estimators import ESTIMATORS
from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.options import check, option
from joint_id_ros.parameters import assignments


@dataclass(frozen=True)
class ModelOptions:
    """What is identified, and how."""

    model: str = option("electromechanical", "joint model", choices=tuple(MODELS))
    joints: tuple[str, ...] = option((), "joints to identify; none: every joint that is seen")
    estimator: str = option("innovations", "estimation method", choices=tuple(ESTIMATORS))
    actuation: str = option("current", "input of models with a drive input", choices=("current", "torque"))
    friction: str = option(LAWS[0], "friction law", choices=LAWS)
    gravity: bool = option(False, "whether the joint carries gravity torque a_g cos(q) + b_g sin(q)")
    kinematic_error: bool = option(False, "whether the gear's kinematic error is modelled")
    set: tuple[str, ...] = option((), 'start values, and values of fixed parameters, as "NAME=VALUE"')
    fix: tuple[str, ...] = option((), 'parameters to hold, as "NAME" or "NAME=VALUE"')
    free: tuple[str, ...] = option((), "parameters to estimate although the model holds them")
    autostart: bool = option(True, "configure and activate at start, without a lifecycle manager")

    def __post_init__(self) -> None:
        check(self)

    def build(self) -> Model:
        """The model; an option that it does not have may stay at its default.

        Raises:
            JointIdError: an option that the model does not have.
        """
        own = {f.name for f in fields(MODELS[self.model])}
        defaults = {f.name: f.default for f in fields(self)}
        given = {n: getattr(self, n) for n in ("actuation", "friction", "gravity", "kinematic_error")}
        return build(self.model, **{n: v for n, v in given.items() if n in own or v != defaults[n]})

    def values(self) -> dict[str, float]:
        """Values given with `set` and `fix`."""
        return assignments(self.set, "set") | assignments((f for f in self.fix if "=" in f), "fix")

    def fixed(self) -> list[str]:
        """Names given with `fix`."""
        return [f.partition("=")[0].strip() for f in self.fix]
