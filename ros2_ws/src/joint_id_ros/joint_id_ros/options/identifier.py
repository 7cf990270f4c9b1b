"""ROS parameters of the identifier: model, estimator and parameter settings."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.assignments import numbers_by_name
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ESTIMATORS, Estimator, Innovations, ParameterSettings
from joint_id_core.estimators import build as build_estimator
from joint_id_core.models.options import ModelOptions
from joint_id_core.models.per_joint import Entry, parse
from joint_id_core.options import option, same_option


@dataclass(frozen=True)
class IdentifierOptions(ModelOptions):
    """Model, estimator and parameter settings of the identifier.

    Settings of one joint in `set`, `fix` and `free` take precedence over settings of all joints.

    Raises:
        JointIdError: a value that is not one of the choices, a text of another form, a joint that is not among
            `joints`, a parameter that is set twice, an option that the estimator does not have.
    """

    joints: tuple[str, ...] = option((), "joints to identify; none: every joint that is seen")
    estimator: str = option(Innovations.name, "estimation method", choices=tuple(ESTIMATORS))
    cell: str = same_option(Innovations, "cell")
    priors: str = option(
        "", "standard deviations known before any data, NAME=SD separated by commas; relative for positive parameters"
    )
    set: tuple[str, ...] = option(
        (),
        'start values, and values of fixed parameters, as "NAME=VALUE" or "NAME=VALUE+-SD" (what is known of a fixed '
        'one), or for one joint "JOINT.NAME=VALUE"',
    )
    fix: tuple[str, ...] = option(
        (), 'parameters to hold, as "NAME" or "NAME=VALUE", or for one joint with "JOINT." in front'
    )
    free: tuple[str, ...] = option(
        (), 'parameters to estimate although the model holds them, as "NAME", or for one joint "JOINT.NAME"'
    )
    state_file: str = option(
        "", "file that keeps what is known, so that a restart goes on with it; one for every robot; empty: none"
    )
    autostart: bool = option(True, "configure and activate at start, without a lifecycle manager")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.estimator != Innovations.name and (self.cell, self.priors) != (Innovations.cell, ""):
            raise JointIdError(
                f"cell and priors are for the innovations estimator: leave them out with {self.estimator}"
            )
        for parameter in ("set", "fix", "free"):
            self._check(parameter)

    def _check(self, parameter: str) -> None:
        seen: list[tuple[str, str]] = []
        for text, entry in zip(getattr(self, parameter), self._entries(parameter), strict=True):
            if entry.joint and self.joints and entry.joint not in self.joints:
                raise JointIdError(
                    f"parameter {parameter}: {text!r} is for joint {entry.joint}, which is not identified: parameter "
                    f"joints has {', '.join(self.joints)}"
                )
            if (entry.joint, entry.name) in seen:
                raise JointIdError(f"parameter {parameter}: {text!r} speaks of {entry.name} again: say it once")
            seen.append((entry.joint, entry.name))

    @property
    def solver(self) -> Estimator:
        """The estimator with its options."""
        return build_estimator(self.estimator, **({"cell": self.cell} if self.estimator == Innovations.name else {}))

    def settings(self, joint: str) -> ParameterSettings:
        """Return the parameter settings of a joint.

        Raises:
            JointIdError: priors that are not of the form NAME=SD, or not above zero.
        """
        priors = numbers_by_name(filter(None, map(str.strip, self.priors.split(","))), "parameter priors")
        known = self.values(joint), self.fixed(joint), self.freed(joint), priors, self.deviations(joint)
        return ParameterSettings(*known)

    @property
    def expected(self) -> tuple[str, ...]:
        """Joints that must be in the samples: those to identify, or else those named in `set`, `fix` or `free`."""
        entries = (e for parameter in ("set", "fix", "free") for e in self._entries(parameter))
        return self.joints or tuple(dict.fromkeys(e.joint for e in entries if e.joint))

    def values(self, joint: str) -> dict[str, float]:
        """Return the values given for a joint with `set` and `fix`."""
        return {e.name: e.value for e in self._given(joint) if e.value is not None}

    def deviations(self, joint: str) -> dict[str, float]:
        """Return the standard deviations of these values, where they are given."""
        return {e.name: e.deviation for e in self._given(joint) if e.deviation is not None}

    def _given(self, joint: str) -> list[Entry]:
        """Return the entries of `set` and `fix` that hold for a joint, those of the joint alone last."""
        entries = [e for parameter in ("set", "fix") for e in self._entries(parameter)]
        return [e for scope in ("", joint) for e in entries if e.joint == scope]

    def fixed(self, joint: str) -> list[str]:
        """Return the parameters given for a joint with `fix`."""
        freed = {e.name for e in self._entries("free") if e.joint == joint != ""}
        return [e.name for e in self._entries("fix") if e.joint == joint or (not e.joint and e.name not in freed)]

    def freed(self, joint: str) -> list[str]:
        """Return the parameters given for a joint with `free`."""
        return [e.name for e in self._entries("free") if e.joint in ("", joint)]

    def _entries(self, parameter: str) -> list[Entry]:
        return [parse(text, parameter) for text in getattr(self, parameter)]
