"""What is fitted: the recordings of a joint, and with a robot's description the load of its other joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from joint_id_core.assignments import vector
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.arm.description import Description
    from joint_id_core.data.recording import Recording


@dataclass(frozen=True)
class Given:
    """Recordings that are fitted, one that the fit must predict, what is said of how they came about, and a doubt."""

    recordings: list[Recording]
    other: Recording | None = None
    notes: tuple[str, ...] = ()
    doubt: str = ""


@dataclass(frozen=True)
class Part:
    """The part of the files of a recording that is fitted; fields as the options of the command."""

    mapping: Mapping[str, str]
    start: float | None
    end: float | None

    def read(self, file: Path, joint: str | None) -> Recording:
        """Read it from a file."""
        from joint_id_core import formats

        return window(formats.read(file, joint, self.mapping), self.start, self.end)

    def read_joints(self, file: Path, joints: Collection[str]) -> dict[str, Recording]:
        """Read it of several joints, by name, from a file: a bag in one pass."""
        from joint_id_core import formats

        if len(joints) < 2:
            return {name: self.read(file, name) for name in joints}
        found = formats.read_joints(file, self.mapping).recordings
        records = {}
        for name in joints:
            one = found[name]
            if isinstance(one, JointIdError):
                raise one
            records[name] = window(one, self.start, self.end)
        return records


def joints_of(file: Path, mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Return the joints of a file.

    Raises:
        JointIdError: it holds one joint without a name.
    """
    from joint_id_core import formats

    found = formats.joints(file, mapping)
    if not found:
        raise JointIdError(
            f"{file} holds one joint without a name: give a bag, or a table with columns of all joints (name those of "
            "other names with --map link_position=NAME_# and so on, where # is the number of the joint)"
        )
    return found


def names_in(joints: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Return by the name of a joint in a file its name in the description of a robot, which has these joints.

    Joints that a table only numbers are those of the description in their order, if there are as many.
    """
    from joint_id_core.formats.joint_columns import number_of

    numbers = {name: number for name in names if (number := number_of(name)) is not None}
    same = {*names} & {*joints}
    if same or len(numbers) != len(names) or len(names) != len(joints):
        return {name: name for name in names}
    return dict(zip(sorted(numbers, key=numbers.__getitem__), joints, strict=True))


def in_order(source: str, names: Mapping[str, str]) -> str:
    """Return in words which joints of a file are which of a description; "" if they have the same names."""
    if all(own == known for own, known in names.items()):
        return ""
    pairs = ", ".join(f"{own} = {known}" for own, known in names.items())
    return f"The joints are taken in the order of {source}: {pairs}."


def plain(files: Sequence[Path], joint: str | None, part: Part, validate: Path | None) -> Given:
    """Read the part of every file that is fitted, and all of the one to `validate` with."""
    other = None if validate is None else Part(part.mapping, None, None).read(validate, joint)
    return Given([part.read(file, joint) for file in files], other)


def with_load(
    files: Sequence[Path], joint: str | None, part: Part, validate: Path | None, description: Description
) -> Given:
    """Read them with the load that the rest of the arm puts on the joint.

    Raises:
        JointIdError: no joint is named; the recordings of the other joints are not what is needed.
    """
    from joint_id_core import formats

    if joint is None:
        raise JointIdError(f"--urdf needs the name of the joint: --joint {description.joints[0]}, or --joint all")
    names = names_in(description.joints, formats.joints(files[0], part.mapping))
    own, told = names.get(joint, joint), in_order(description.source, names)
    description.require(own)
    parts = [(file, part) for file in files]
    parts += [] if validate is None else [(validate, Part(part.mapping, None, None))]
    records = []
    for file, one in parts:
        found = names_in(description.joints, formats.joints(file, part.mapping)) or {joint: joint}
        there = {name: known for name, known in found.items() if known in description.joints}
        read = one.read_joints(file, there)
        records.append({known: replace(read[name], joint=known) for name, known in there.items()})
    done = given_with_load(description, own, records)
    notes, other = (*done.notes, *([told] if told else [])), done.recordings[-1] if validate else None
    return replace(done, recordings=done.recordings[: len(files)], other=other, notes=notes)


def described(urdf: Path, base_gravity: str | None, still: Collection[str] = ()) -> Description:
    """Read the description of a robot whose base stands as `base_gravity` (X,Y,Z in m/s^2) says; None: upright.

    Joints that stand `still` count as fixed.
    """
    from joint_id_core.arm.description import GRAVITY, Description

    return Description.read(urdf, GRAVITY if base_gravity is None else vector(base_gravity, "--base-gravity"), still)


def given_with_load(description: Description, joint: str, records: Sequence[Mapping[str, Recording]]) -> Given:
    """Return recordings of a joint, of all joints by name, with the load that the rest of the arm puts on it."""
    from joint_id_core.arm.gravity_direction import other_gravity
    from joint_id_core.arm.loaded import loaded

    done = loaded(description, joint, records)
    return Given(list(done.recordings), notes=(done.text,), doubt=other_gravity(description, records))


def window(recording: Recording, start: float | None, end: float | None) -> Recording:
    """Return the part of a recording between two instants, given in s after its first sample.

    Raises:
        JointIdError: this part has no sample.
    """
    for option, value in (("--start", start), ("--end", end)):
        if value is not None and not value >= 0.0:
            raise JointIdError(f"{option} {value:g}: give a time in s after the first sample, 0 or more")
    if start is None and end is None:
        return recording
    first = recording.time[0] if len(recording) else 0.0
    part = recording.window(first + (start or 0.0), float("inf") if end is None else first + end)
    if not len(part):
        raise JointIdError(
            f"{recording.source}: no sample between --start and --end: it lasts {recording.duration:.6g} s"
        )
    return part
