"""The file with the robots of a fleet: a name each, and the arguments of its launch file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from joint_id_core.errors import JointIdError
from joint_id_ros.launch_files import LAUNCH_FILES, LOG_LEVEL, NAMESPACE, RESPAWN, Argument, NodeStart

KINDS = ("robot", "arm")  # launch files of which a robot of a fleet has the nodes; the first one is the default
NOT_TAKEN = (NAMESPACE.name, LOG_LEVEL.name, RESPAWN.name)  # the name is the namespace, the rest is the fleet's
OWN_FILES = ("state_file", "baseline_file")  # two robots that wrote the same one would mix what is known of them
PLACE = "{robot}"  # in a text, stands for the name of the robot


@dataclass(frozen=True)
class Robot:
    """A robot of a fleet.

    Attributes:
        name: its namespace, without the first slash.
        starts: the nodes to start.
        problem: why there are none; empty if all is well.
    """

    name: str
    starts: tuple[NodeStart, ...] = ()
    problem: str = ""


def read_robots(path: str | Path) -> tuple[Robot, ...]:
    """Return the robots of a file; what is wrong with one of them alone is its `problem`.

    Raises:
        JointIdError: the file cannot be read, is no YAML of this form, has a robot without a name or with one that is
            no namespace, or two of the same name.
    """
    try:
        content = yaml.load(Path(path).read_text(encoding="utf-8"), _Strict)  # is a SafeLoader
    except (OSError, UnicodeDecodeError) as error:
        raise JointIdError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    except yaml.YAMLError as error:
        raise JointIdError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict) or not isinstance(content.get("robots"), list) or not content["robots"]:
        raise JointIdError(f'{path}: write "robots:" and below it a list, an entry "- name: NAME" for each robot')
    if wrong := sorted(map(str, content.keys() - {"all", "robots"})):
        raise JointIdError(f"{path}: {', '.join(wrong)}: a file of robots has only the parts all and robots")
    common = content.get("all") or {}
    if not isinstance(common, dict):
        raise JointIdError(f"{path}: all: write arguments of every robot, NAME: VALUE")
    try:
        _check_names(common, {**_arguments(KINDS[0]), **_arguments(KINDS[1])}, "robot.launch.py or arm.launch.py")
    except JointIdError as error:
        raise JointIdError(f"{path}: all: {error}") from None
    entries = [_named(path, k, entry) for k, entry in enumerate(content["robots"], 1)]
    names = [name for name, _ in entries]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise JointIdError(f"{path}: two robots have the name {', '.join(twice)}: give each its own")
    taken: dict[tuple[str, str], str] = {}
    return tuple(_robot(name, common, entry, taken) for name, entry in entries)


def _named(path: str | Path, number: int, entry: Any) -> tuple[str, dict[str, Any]]:
    """Return name and arguments of an entry."""
    name = entry.get("name") if isinstance(entry, dict) else None
    if not isinstance(name, str) or not name.strip("/"):
        raise JointIdError(f"{path}: robot {number} has no name: give it one, such as cell_1/left")
    name = name.strip("/")
    try:
        validate_namespace(f"/{name}")
    except InvalidNamespaceException as error:
        raise JointIdError(f"{path}: robot {number}: {' '.join(str(error).split())}") from None
    return name, {key: value for key, value in entry.items() if key != "name"}


def _robot(name: str, common: dict[str, Any], own: dict[str, Any], taken: dict[tuple[str, str], str]) -> Robot:
    try:
        starts = _starts(name, common, own)
        for start, option, path in _files(starts):
            other = taken.setdefault((option, path), name)
            if other != name:
                raise JointIdError(
                    f"{option} of {start} is {path}, as that of {other}: give each robot its own, for example "
                    f"{option}: {PLACE}.json"
                )
    except JointIdError as error:
        return Robot(name, problem=str(error))
    return Robot(name, starts)


def _arguments(kind: str) -> dict[str, Argument]:
    """Return the arguments of a launch file that a robot of a fleet may have."""
    return {a.name: a for a in LAUNCH_FILES[kind].arguments if a.name not in NOT_TAKEN}


def _check_names(given: Mapping[str, Any], arguments: Mapping[str, Argument], where: str) -> None:
    for key in given.keys() - arguments.keys():
        near = difflib.get_close_matches(str(key), arguments, n=1)
        advice = f"did you mean {near[0]}?" if near else "see its page"
        raise JointIdError(f"{key} is no argument of {where}: {advice}")


def _starts(name: str, common: dict[str, Any], own: dict[str, Any]) -> tuple[NodeStart, ...]:
    """Return the nodes of a robot.

    Raises:
        JointIdError: an argument that its launch file does not have, lacks or cannot use.
    """
    kind = own.pop("launch", KINDS[0])
    if kind not in KINDS:
        raise JointIdError(f"launch: {kind}: choose one of {', '.join(KINDS)}")
    arguments = _arguments(kind)
    _check_names(own, arguments, f"{kind}.launch.py")
    given = {key: value for key, value in common.items() if key in arguments} | own
    texts = {key: _text(key, value).replace(PLACE, name.replace("/", "_")) for key, value in given.items()}
    for key, argument in arguments.items():
        if argument.default is None and not texts.get(key):
            raise JointIdError(f"{key} is missing: it must be given")
        if argument.choices and key in texts and texts[key] not in argument.choices:
            raise JointIdError(f"{key}: {texts[key]}: choose one of {', '.join(argument.choices)}")
    values = {key: texts.get(key, argument.default or "") for key, argument in arguments.items()}
    return tuple(LAUNCH_FILES[kind].starts(values, texts.keys()))


def _text(key: str, value: object) -> str:
    """Return a value as the text of an argument."""
    if isinstance(value, list):
        return ",".join(_text(key, one) for one in value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int | float):
        return str(value)
    raise JointIdError(f"{key}: {value!r} is no text, no number and no list of these")


def _files(starts: Sequence[NodeStart]) -> list[tuple[str, str, str]]:
    """Return node, option and path of every file that a node of the robot would write."""
    found = []
    for start in starts:
        for option in OWN_FILES:
            if path := start.given.get(option) or _in_files(start, option):
                found.append((start.name, option, str(Path(str(path)).expanduser().absolute())))
    return found


def _in_files(start: NodeStart, option: str) -> object:
    """Return what the parameter files of a node say of an option."""
    value: object = ""
    for path in start.files:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        for section, part in (content if isinstance(content, dict) else {}).items():
            if str(section).rsplit("/", 1)[-1] in (start.name, "**") and isinstance(part, Mapping):
                value = (part.get("ros__parameters") or {}).get(option, value)
    return value


class _Strict(yaml.SafeLoader):
    """A loader that does not take the last of two entries with the same key in silence."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Make a dict.

        Raises:
            YAMLError: a key that is there twice.
        """
        keys = [key.value for key, _ in node.value]
        if twice := sorted({str(key) for key in keys if keys.count(key) > 1}):
            raise yaml.constructor.ConstructorError(None, None, f"{', '.join(twice)}: is there twice", node.start_mark)
        return super().construct_mapping(node, deep)
