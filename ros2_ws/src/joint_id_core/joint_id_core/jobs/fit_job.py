"""The work of `joint-id fit` on one joint: read, build the model, fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Estimator, ParameterSettings, Regression, fit_several
from joint_id_core.jobs.given import Given, Part, described, in_order, joints_of, names_in, plain, with_load
from joint_id_core.jobs.robot_file import joints_of_robot, robot_settings
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.together.fit import Together
    from joint_id_core.models import Model
    from joint_id_core.options import Progress
    from joint_id_core.results.estimate import Estimate

ALL = "all"  # the name that stands for every joint


@dataclass(frozen=True)
class FitJob:
    """What is fitted, and how; the fields are the arguments of the command. Without a `model`, it is found."""

    files: Sequence[Path]
    joint: str | None
    mapping: Mapping[str, str]
    start: float | None
    end: float | None
    model_options: Mapping[str, Any]
    settings: ParameterSettings
    estimator: Estimator
    robot: str | None = None
    urdf: Path | None = None
    base_gravity: str | None = None
    still: Sequence[str] = ()
    joints: Sequence[str] = ()  # of the files, if they were read already

    def __post_init__(self) -> None:
        for option, given in (("--base-gravity", self.base_gravity), ("--still", self.still)):
            if given and self.urdf is None:
                raise JointIdError(f"{option} is for the robot's description: give --urdf, too, or leave it out")

    def chosen(self) -> FitJob:
        """Return the job for all joints, if none is named, no model either, and the first file holds several."""
        from joint_id_core import formats

        if self.joint is None and "model" not in self.model_options:
            return self if len(formats.joints(self.files[0], self.mapping)) < 2 else replace(self, joint=ALL)
        return self

    def given(self, validate: Path | None = None) -> Given:
        """Read what is fitted, and a recording to `validate` with."""
        part = Part(self.mapping, self.start, self.end)
        if self.urdf is not None:
            description = described(self.urdf, self.base_gravity, self.still)
            return with_load(self.files, self.joint, part, validate, description)
        return plain(self.files, self.joint, part, validate)

    def built(self, recording: Recording) -> Model:
        """Return the model, for the drive that a recording has."""
        options = ModelOptions(**self.model_options)
        return options.build(options.drive_in(recording))

    def settings_for(self, model: Model) -> ParameterSettings:
        """Return the settings of the command, over those of the robot's file."""
        if self.robot is None:
            return self.settings
        joint = self.joint and self._in_robot().get(self.joint, self.joint)
        return self.settings.over(robot_settings(self.robot, joint, model.parameter_names))

    def _in_robot(self) -> dict[str, str]:
        """Return by the name of a joint in the files its name in the file of the robot, if they only number it."""
        from joint_id_core.formats.joint_columns import number_of

        if self.robot is None or self.joint is None or number_of(self.joint) is None:
            return {}
        known = joints_of_robot(self.robot)
        if not known or self.joint in known:
            return {}
        return names_in(known, self.joints or joints_of(self.files[0], self.mapping))

    def run(self, given: Given | None = None, progress: Progress | None = None) -> Result:
        """Fit one joint, from recordings that were read already, or else from the files.

        Without a model, those that the signals allow are fitted, the richest first, until one describes the motion.
        """
        given = given or self.given()
        if "model" in self.model_options:
            return Result(self, self._fitted(given, progress))
        from joint_id_core.comparison.proposal import proposals

        first = given.recordings[0]
        left_out, by_another, found = list[str](), list[Result](), proposals(first, self.model_options)
        models = [proposal.options.build(proposal.options.drive_in(first)) for proposal in found]
        if not any(suited := [self._suits(model) for model in models]):
            suited = [True] * len(models)  # the first fit says what is wrong
        found, models = list(compress(found, suited)), list(compress(models, suited))
        for name in self.settings.names:
            if not any(name in model.parameter_names for model in models):
                models[-1].parameter(name)  # says what there is
        for proposal, model in zip(found, models, strict=True):
            options = {n: getattr(proposal.options, n) for n in ("model", "gravity", *self.model_options)}
            job = replace(self, model_options=options, settings=self.settings.of(model))
            if model is not models[-1] and (doubt := job._fails_soon(model, given, progress)):
                left_out.append(f"{model.name} was tried on {doubt}")
                continue
            together = job._fitted(given, progress)
            result = Result(job, together, (f"model {proposal}", *left_out))
            doubt = _doubt(model, together.estimate, 1.0 / first.period)
            if not doubt:
                if together.estimate.estimator == self.estimator.name:
                    return result
                by_another.append(result)  # a simpler model may do without another estimator
                doubt = f"{self.estimator.name} do not describe the motion"
            left_out.append(f"{model.name} was tried and left out: {doubt}")
        return by_another[0] if by_another else result

    def _suits(self, model: Model) -> bool:
        """Return whether the model takes the load of a description, if there is one, and suits the estimator."""
        if self.urdf is not None and model.load is None:
            return False
        if not isinstance(self.estimator, Regression):
            return True
        from joint_id_core.estimators.regression.fit import suits  # loads SciPy

        return suits(model)

    def _fails_soon(self, model: Model, given: Given, progress: Progress | None) -> str:
        """Return on what a model with a gear, whose fits take long, was tried, and why it does not describe that part.

        Empty if it may describe the motion.
        """
        if model.stiffness is None:
            return ""
        from joint_id_core.jobs.excerpt import excerpt  # loads NumPy
        from joint_id_core.results.status import Status

        part = excerpt(model, given.recordings[0], self.settings_for(model))
        if part is None:
            return ""
        found = self._fitted(replace(given, recordings=[part]), progress).estimate
        if found.status not in (Status.POOR_FIT, Status.DIVERGED):
            return ""
        return f"the {part.duration:.3g} s with the most motion and left out: {found.message}"

    def _fitted(self, given: Given, progress: Progress | None) -> Together:
        model = self.built(given.recordings[0])
        if self.urdf is not None and model.load is None:
            raise JointIdError(f"{model.name} takes no load: leave --urdf out, or take another model")
        settings = self.settings_for(model)
        _, free = settings.applied_to(model)
        if doubled := [name for name in self.settings.deviations if name in free]:
            raise JointIdError(
                f"--set {doubled[0]}: +- is for a parameter that is held, and {doubled[0]} is estimated: hold it with "
                f"--fix, or give what is known before with --prior {doubled[0]}=SD"
            )
        found = fit_several(model, given.recordings, settings, self.estimator, progress)
        if told := in_order(self.robot or "", self._in_robot()):
            found = replace(found, estimate=replace(found.estimate, notes=(*found.estimate.notes, told)))
        if self.urdf is None:
            return found
        return replace(found, estimate=_told(found.estimate, given))

    def of_every_joint(self) -> list[FitJob]:
        """Return one job for every joint that the files hold.

        Raises:
            JointIdError: a file holds one joint without a name.
        """
        from joint_id_core import formats

        names: dict[str, None] = {}
        for file in self.files:
            found = formats.joints(file, self.mapping)
            if not found:
                raise JointIdError(
                    f"{file}: --joint {ALL} needs a file with several joints; this one holds one without a name"
                )
            names |= dict.fromkeys(found)
        return [replace(self, joint=name) for name in names]


def _told(estimate: Estimate, given: Given) -> Estimate:
    """Return an estimate with what is said of its recordings; a doubt about them comes before other notes."""
    if not given.doubt:
        return replace(estimate, notes=(*estimate.notes, *given.notes))

    notes = (*estimate.notes[:1], given.doubt, *estimate.notes[1:], *given.notes)
    return estimate.noted(notes)


def _doubt(model: Model, estimate: Estimate, rate: float) -> str:
    """Return why a simpler model should be tried; empty if this one describes the motion, with its gear.

    `rate` is the sampling rate in Hz. What takes the place of the gear of a stiff joint, as noise or a filter of one
    encoder do, oscillates beyond what it shows.
    """
    if not estimate.status.describes:
        return estimate.message
    if model.stiffness not in estimate.free:
        return ""
    if estimate[model.stiffness].verdict.value != "estimated":
        return f"this motion does not show {model.stiffness}"
    from joint_id_core.estimators.shared.oscillation import fastest_oscillation  # loads NumPy

    fastest = fastest_oscillation(model, estimate.values)
    if fastest > 0.5 * rate:
        return f"its gear would oscillate at {fastest:.3g} Hz, which {rate:.4g} samples/s do not show"
    return ""


@dataclass(frozen=True)
class Result:
    """A fit: the job with the model that was fitted, and why it is this one."""

    job: FitJob
    together: Together
    why: tuple[str, ...] = ()

    @property
    def estimate(self) -> Estimate:
        """The estimate of all recordings."""
        return self.together.estimate
