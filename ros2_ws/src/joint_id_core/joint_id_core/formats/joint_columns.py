"""Tables with columns of several joints: `q1` to `q7`, `tau_1`, `arm_1_joint_position`, `/joint_states/elbow/effort`.

A column's name is a word for a channel and the number of a joint, or the name of a joint and then such a word. What is
commanded, computed or filtered is no measurement: `q_desired_1` is the reference, `tau_gravity_1` is left alone.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import Path

from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.formats import robot_log
from joint_id_core.formats.column_names import factor_of, without_unit

ANY = "#"  # stands for the number of the joint in a mapping, as in `--map link_position=q_#`
NUMBERED = "joint_"  # before the number of a joint that has no other name
WORDS = {
    "link_position": ("q", "pos", "position", "positions", "angle", "angles"),
    "link_velocity": ("dq", "qd", "qdot", "q dot", "dot q", "d q", "vel", "velocity", "velocities", "speed"),
    "torque": ("tau", "trq", "torque", "torques", "motor torque", "effort", "efforts"),
    "current": ("cur", "curr", "current", "currents", "motor current"),
    "voltage": ("motor voltage",),
    "motor_position": ("motor angle", "motor pos"),
    "motor_velocity": ("motor speed", "motor vel"),
}
# By tokens of a name, the longest first. A channel has its own name, too.
CHANNEL = {
    tuple(word.replace("_", " ").split()): channel
    for channel in CHANNELS
    for word in (channel, *WORDS.get(channel, ()))
}  # fmt: skip
LONGEST = max(map(len, CHANNEL))
TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]+|\d+")  # also of `jointPosition1`
# Words that say nothing of which joint it is, or that what stands there was measured.
BESIDE = {
    "act", "actual", "axis", "data", "feedback", "field", "j", "jnt", "joint", "joints", "link", "log", "meas",
    "measured", "msr", "robot", "state", "states",
}  # fmt: skip
COMMANDED = {"cmd", "command", "commanded", "des", "desired", "ref", "reference", "target"}
OF_COMMAND = {"link_position": "reference_position", "current": "target_current"}
# What is no measurement of the joint, or another quantity.
OTHER = {
    "acc", "coriolis", "d", "dd", "err", "error", "est", "estimated", "ext", "external", "filt", "filtered", "friction",
    "gravity", "limit", "max", "mean", "min", "model", "motor", "pred", "predicted", "raw", "residual", "sim",
    "simulated", "std", "time",
}  # fmt: skip
POSITIONS = ("link_position", "motor_position")
BESIDE_POSITION = ("link_velocity", "motor_velocity", "torque", "current")  # one of them, of a joint with a name


def joints(path: Path, found: Collection[str], mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the joints of the columns `found`, in their order; () for a table of one unnamed joint.

    Numbered joints are `joint_1` and so on, those of a UR robot's log have the names of its driver. A mapping of
    channels makes one unnamed joint, unless it names columns of every joint, with a `#`.

    Raises:
        JointIdError: two columns for one channel of a joint; a mapping with `#` that no columns, or not all, have.
    """
    return tuple(_by_joint(path, found, mapping))


def columns(path: Path, found: Collection[str], joint: str, mapping: Mapping[str, str]) -> dict[str, str]:
    """Return the mapping that reads a joint, with what the user's `mapping` adds.

    Raises:
        JointIdError: the table holds several joints and none of this name; a column twice; as `joints`.
    """
    by_joint = _by_joint(path, found, mapping)
    if not by_joint:
        return {**_of_one(path, found, mapping), **mapping}
    names = tuple(by_joint)
    if joint not in names and (joint or len(names) > 1):
        none = f"no joint {joint!r}: it holds" if joint else "the joints"
        raise JointIdError(f"{path} holds {none} {', '.join(names)}: choose one of them (--joint {names[0]})")
    own = {target: expression for target, expression in mapping.items() if ANY not in expression}
    return {**by_joint[joint or names[0]], **own}


def in_words(path: Path, found: Collection[str], mapping: Mapping[str, str]) -> list[str]:
    """Return in words from which columns the channels of every joint are read; [] for a table of one joint."""
    words: dict[str, list[str]] = {}
    for own in _by_joint(path, found, mapping).values():
        for channel, column in own.items():
            words.setdefault(channel, []).append(column)
    return [f"{channel} = {', '.join(columns)}" for channel, columns in words.items()]


def _by_joint(path: Path, found: Collection[str], mapping: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return by joint the mapping that reads it."""
    if any(ANY in expression for expression in mapping.values()):
        return _numbered(path, found, mapping)
    if any(name in CHANNELS for name in (*found, *mapping)):
        return {}
    if names := robot_log.joints(found):
        return {name: robot_log.columns(found, name) for name in names}
    by_joint: dict[str, dict[str, str]] = {}
    for column in found:
        if (known := understood(column)) is not None and known[0]:
            joint, channel, expression = known
            if channel in by_joint.setdefault(joint, {}):
                raise JointIdError(
                    f"{path}: {by_joint[joint][channel]!r} and {column!r} could both be {channel} of {joint}: rename "
                    f"one, or say which (--map {channel}=COLUMN, with {ANY} for the number of the joint)"
                )
            by_joint[joint][channel] = expression
    by_joint = {name: own for name, own in by_joint.items() if _is_joint(name, own)}
    # One name by itself may be of a part of an unnamed joint, whose other columns have no name.
    several = len(by_joint) > 1 or any(number_of(name) is not None for name in by_joint)
    return by_joint if several or not any(_is_of_one(column) for column in found) else {}


def _numbered(path: Path, found: Collection[str], mapping: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return by joint what a mapping with `#` names."""
    patterns = {target: expression for target, expression in mapping.items() if ANY in expression}
    numbers: dict[str, dict[str, None]] = {}
    for target, expression in patterns.items():
        part = next(p.strip() for p in expression.split("*") if ANY in p)
        matcher = re.compile(re.escape(part).replace(re.escape(ANY), r"(\d+)"))
        numbers[target] = dict.fromkeys(m.group(1) for name in found if (m := matcher.fullmatch(name)))
        if not numbers[target]:
            raise JointIdError(f"{path}: {target}={expression}: no column is called so with a number for {ANY}")
    first, every = next(iter(numbers.items()))
    for target, own in numbers.items():
        if set(own) != set(every):
            raise JointIdError(
                f"{path}: {first}={patterns[first]} has columns of the joints {', '.join(every)}, "
                f"{target}={patterns[target]} of {', '.join(own)}: they must be the same"
            )
    return {f"{NUMBERED}{n}": {t: e.replace(ANY, n) for t, e in patterns.items()} for n in every}


def _of_one(path: Path, found: Collection[str], mapping: Mapping[str, str]) -> dict[str, str]:
    """Return the mapping that reads a table of one joint whose channels have other words, as far as they are clear."""
    own: dict[str, list[str]] = {}
    for column in found:
        if column not in CHANNELS and (known := understood(column)) is not None and not known[0]:
            own.setdefault(known[1], []).append(known[2])
            if own[known[1]].count(known[2]) > 1 and known[1] not in {*found, *mapping}:
                raise JointIdError(f"{path}: two columns are called {column!r}: rename one")
    return {channel: one for channel, (one, *others) in own.items() if not others and channel not in {*found, *mapping}}


def _is_of_one(column: str) -> bool:
    known = understood(column)
    return known is not None and not known[0]


def _is_joint(name: str, own: Mapping[str, str]) -> bool:
    beside = number_of(name) is not None or any(n in own for n in BESIDE_POSITION)
    return beside and any(n in own for n in POSITIONS)


def number_of(joint: str) -> int | None:
    """Return the number of a joint that a table only numbers; None if it has another name."""
    number = joint.removeprefix(NUMBERED)
    return int(number) if joint.startswith(NUMBERED) and number.isdecimal() else None


def understood(column: str) -> tuple[str, str, str] | None:
    """Return joint ("" for none), channel and expression of a column; None if it is not one of a joint's channels."""
    name, unit = without_unit(column)
    tokens = list(TOKEN.finditer(name))
    lower = [token.group().lower() for token in tokens]
    told = [word for word in lower if word not in BESIDE | COMMANDED]
    numbers = [word for word in told if word.isdecimal()]
    word = tuple(word for word in told if word not in numbers)
    joint, left = "", list[str]()
    if word in CHANNEL and len(numbers) < 2:
        joint = f"{NUMBERED}{int(numbers[0])}" if numbers else ""
    else:
        count = next((c for c in range(min(LONGEST, len(tokens) - 1), 0, -1) if tuple(lower[-c:]) in CHANNEL), 0)
        if not count:
            return None
        word, left = tuple(lower[-count:]), lower[:-count]
        joint = name[: tokens[-count].start()].strip(" -_./[]()").rpartition("/")[2]
    channel = CHANNEL[word]
    if COMMANDED & {*lower}:
        channel = OF_COMMAND.get(channel, "")
    factor = factor_of(channel, unit)
    if factor is None or OTHER & {*left}:
        return None
    return joint, channel, column if factor == 1.0 else f"{factor!r}*{column}"


def is_of_a_joint(column: str) -> bool:
    """Return whether a column is a channel of one joint of several."""
    known = understood(column)
    return known is not None and bool(known[0])
