"""What a parameter file of the identifier node says of a robot: gear ratios, torque constants, what is held."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any

from joint_id_core.errors import JointIdError, close_to
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import MODELS, build
from joint_id_core.models.lacking import option_for
from joint_id_core.models.options import ModelOptions
from joint_id_core.models.per_joint import Entry, parse

NODE = "identifier"
KINDS = ("set", "fix", "free")
ROBOTS = Path(__file__).parents[1] / "robots"  # files that are part of this package


def robot_settings(robot: str, joint: str | None, names: Collection[str]) -> ParameterSettings:
    """Return the settings `set`, `fix` and `free` of a file for a joint, of the parameters with these names.

    Args:
        robot: path of the file, or the name of a robot: NAME.yaml in the folder config, or in this package.
        joint: name of the joint, as in the file; None takes what holds for all joints.
        names: of the parameters of a model.

    Raises:
        JointIdError: no such file, it cannot be read, holds no parameters of the node, or names that nothing has.
    """
    path = path_of(robot)
    parameters = _parameters(path)
    entries = {kind: _entries(parameters[kind], kind, joint) for kind in KINDS}
    for one in sorted({e.name for kind in KINDS for e in entries[kind]} - set(names)):
        _require_known(path, one)
    values = {e.name: e.value for kind in ("set", "fix") for e in entries[kind] if e.value is not None}
    deviations = {e.name: e.deviation for kind in ("set", "fix") for e in entries[kind] if e.deviation is not None}
    fixed, freed = ([e.name for e in entries[kind]] for kind in ("fix", "free"))
    return ParameterSettings(values, fixed, freed, deviations=deviations).only(names)


def joints_of_robot(robot: str) -> tuple[str, ...]:
    """Return the joints that a file names, in its order.

    Raises:
        JointIdError: as `robot_settings`.
    """
    path = path_of(robot)
    parameters = _parameters(path)
    named = parameters.get("joints")
    if isinstance(named, list) and named:
        return tuple(map(str, named))
    entries = (parse(str(text), kind) for kind in KINDS for text in parameters[kind])
    return tuple(dict.fromkeys(entry.joint for entry in entries if entry.joint))


def path_of(robot: str) -> Path:
    """Return the path of the file of a robot.

    Raises:
        JointIdError: no such file.
    """
    if (path := Path(robot)).is_file():
        return path
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path("config"), ROBOTS, *(Path(p) / "share/joint_id_ros/config" for p in prefixes if p)]
    found = next((file for folder in folders if (file := folder / f"{robot}.yaml").is_file()), None)
    if found is None:
        known = sorted({file.stem for folder in folders if folder.is_dir() for file in folder.glob("ur*e.yaml")})
        raise JointIdError(
            f"--robot {robot}: no such file: give the path of a parameter file of the identifier; known by name: "
            f"{', '.join(known)}{close_to(robot, known)}"
        )
    return found


def _parameters(path: Path) -> dict[str, Any]:
    """Return the parameters of the identifier in a file."""
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise JointIdError(f"{path}: the file cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise JointIdError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from None
    nodes = content.items() if isinstance(content, dict) else ()
    found = next((v for name, v in nodes if str(name).rpartition("/")[2] == NODE and isinstance(v, dict)), None)
    parameters = None if found is None else found.get("ros__parameters")
    if not isinstance(parameters, dict):
        raise JointIdError(f"{path}: holds no parameters of the node {NODE} (/**/{NODE}: ros__parameters: set: [...])")
    others = {field.name for field in fields(ModelOptions)}
    for key in parameters:
        if key not in KINDS and key not in others and (meant := close_to(key, KINDS)):
            raise JointIdError(f"{path}: {NODE} has no parameter {key!r}{meant}")
    lists = {kind: parameters.get(kind) or [] for kind in KINDS}
    for kind, texts in lists.items():
        if not isinstance(texts, list):
            raise JointIdError(f"{path}: {kind} is no list of texts")
    return {**parameters, **lists}


def _require_known(path: Path, name: str) -> None:
    """Check that a name which one model lacks is that of a parameter of another one."""
    known = {n for model in MODELS for n in build(model).parameter_names}
    if name not in known and not any(option_for(build(model), name) for model in MODELS):
        raise JointIdError(f"{path}: no model has a parameter {name!r}{close_to(name, known)}")


def _entries(texts: list[object], kind: str, joint: str | None) -> list[Entry]:
    """Return the entries for a joint, those that name it last."""
    entries = [parse(str(text), kind) for text in texts if str(text)]
    return [e for e in entries if not e.joint] + [e for e in entries if e.joint and e.joint == joint]
