"""Parse short texts that name models to compare, such as `harmonic_drive:stribeck+gravity`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from joint_id_core.errors import JointIdError
from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.options import DRIVES, FLAGS, drive_of

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording

EVERY_LAW = "all"
GRAMMAR = (
    f"MODEL[:LAW][+OPTION...] with MODEL one of {', '.join(MODELS)}; LAW one of {', '.join(LAWS)}, {EVERY_LAW}; "
    f"OPTION one of {', '.join((*FLAGS, *DRIVES))}"
)


@dataclass(frozen=True)
class Candidate:
    """One model of a comparison.

    Attributes:
        label: its canonical text, always with the friction law.
        model: the model.
        arguments: arguments of `joint-id fit` that build the same model.
    """

    label: str
    model: Model
    arguments: tuple[str, ...]


def parse(models: Sequence[str | Model | Candidate], recording: Recording) -> tuple[Candidate, ...]:
    """Return candidates from models, and from texts such as `rigid_joint:stribeck` or `harmonic_drive:all+gravity`.

    A text without a friction law means the paper's law, `coulomb_viscous`. The law `all` gives one candidate per law;
    so does a single text without a law, because one candidate is no comparison. Without any text the models of
    `every_model` are compared with every law, with gravity if the motion clearly shows it. A model that can be driven
    by torque or current takes the torque if it was recorded, else the current.

    Raises:
        JointIdError: an unknown model, law or option (the message lists the known ones), an option that the model does
            not have, a candidate given twice, fewer than two candidates.
    """
    named = list(models) or list(_every_candidate(recording))
    if len(named) == 1 and isinstance(named[0], str) and ":" not in named[0]:
        name, plus, options = named[0].partition("+")
        named = [f"{name}:{EVERY_LAW}{plus}{options}"]
    found: dict[str, Candidate] = {}
    for item in named:
        for candidate in _candidates(item.strip(), recording) if isinstance(item, str) else [_candidate(item)]:
            if candidate.label in found:
                raise JointIdError(f"candidate {candidate.label} is given twice: give it once")
            found[candidate.label] = candidate
    if len(found) < 2:
        raise JointIdError(
            f"{', '.join(found)} alone is no comparison: give two or more, e.g. "
            f"{next(iter(found)).partition(':')[0]}:{EVERY_LAW} for every friction law"
        )
    return tuple(found.values())


def every_model(recording: Recording) -> tuple[str, ...]:
    """Return the names of the models whose states and drive this recording holds.

    `motor_side` is never among them: it is for a link that other joints move, too, and a recording does not show that.

    Raises:
        JointIdError: no model fits the recording.
    """
    link, motor = (any(recording.measured(f"{side}_{what}") for what in ("position", "velocity")) for side in _SIDES)
    names = []
    if any(recording.measured(drive) for drive in DRIVES):
        names += ["rigid_joint"] * link + ["harmonic_drive"] * (link and motor)
    if recording.measured("voltage"):
        names += ["electromechanical"] * (link and motor) + ["dc_motor"] * (motor and not link)
    if not names:
        raise JointIdError(
            f"{recording.source} holds {', '.join(recording.channels) or 'nothing'}: no model follows from that. "
            "Needed are torque or current and the motion of the link (rigid_joint), or voltage and the motion of the "
            "motor (dc_motor): name columns that were not understood (joint-id info shows them; --map), or the model"
        )
    return tuple(names)


_SIDES = ("link", "motor")


def _every_candidate(recording: Recording) -> Iterator[str]:
    """Yield the texts that are compared if the user names none."""
    from joint_id_core.comparison.gravity import CLEARLY, WITH_GRAVITY, gravity_helps  # loads SciPy

    names = every_model(recording)
    gravity = gravity_helps(recording) > CLEARLY
    for name in names:
        yield f"{name}:{EVERY_LAW}{'+gravity' if gravity and name in WITH_GRAVITY else ''}"


def _candidate(model: Model | Candidate) -> Candidate:
    """Return the candidate of a model; the label of a user's own model is its `repr`."""
    if isinstance(model, Candidate):
        return model
    if type(model) is not MODELS.get(model.name):
        return Candidate(repr(model), model, ())
    options = {f.name: getattr(model, f.name) for f in fields(model)}
    flags = [flag for flag in FLAGS if options.get(flag)]
    drives = [options["actuation"]] if "actuation" in options else []
    return _labelled(model, options.get("friction", LAWS[0]), flags, drives)


def _labelled(model: Model, law: str, flags: Sequence[str], drives: Sequence[str]) -> Candidate:
    """Return a candidate with its canonical text and the arguments that build it."""
    label = "+".join([f"{model.name}:{law}", *flags, *drives])
    arguments = ["--model", model.name, "--friction", law, *(f"--{flag.replace('_', '-')}" for flag in flags)]
    return Candidate(label, model, (*arguments, *(word for drive in drives for word in ("--actuation", drive))))


def _candidates(text: str, recording: Recording) -> Iterator[Candidate]:
    """Yield the candidates that one text stands for."""
    head, *extras = (part.strip() for part in text.split("+"))
    name, colon, law = (part.strip() for part in head.partition(":"))
    extras = [extra.replace("-", "_") for extra in extras]
    unknown = [extra for extra in extras if extra not in (*FLAGS, *DRIVES)]
    wrong = (
        f"model {name!r}" if name not in MODELS
        else f"friction law {law!r}" if colon and law not in (*LAWS, EVERY_LAW)
        else f"option {unknown[0]!r}" if unknown
        else ""
    )  # fmt: skip
    if wrong:
        raise JointIdError(f"candidate {text!r}: no {wrong}; write {GRAMMAR}")
    drives = [extra for extra in extras if extra in DRIVES]
    if len(set(extras)) < len(extras) or len(drives) > 1:
        raise JointIdError(f"candidate {text!r}: {'+'.join(extras)} contradict or repeat each other: give one of each")
    options: dict[str, str | bool] = {flag: True for flag in FLAGS if flag in extras}
    drive = drives[0] if drives else drive_of(name, recording)
    if drive is not None:
        options["actuation"] = drive
    for chosen in LAWS if law == EVERY_LAW else (law or LAWS[0],):
        model = build(name, friction=chosen, **options)
        yield _labelled(model, chosen, [f for f in FLAGS if f in extras], drives)
