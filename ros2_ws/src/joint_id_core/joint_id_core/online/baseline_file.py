"""The baselines of the joints of a robot in one JSON file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate
from joint_id_core.text_file import write_text

FORMAT = "joint_id baselines"
VERSION = 1  # increased when a reader of the previous version would misread a file


def save(path: Path, baselines: Mapping[str, Estimate]) -> None:
    """Write the baseline of each joint. An existing file is replaced only after the new one is complete.

    Raises:
        JointIdError: the file cannot be written.
    """
    joints = {joint: estimate.to_dict() for joint, estimate in sorted(baselines.items())}
    text = json.dumps({"format": FORMAT, "version": VERSION, "joints": joints}, indent=1, allow_nan=False) + "\n"
    write_text(path, text, "the baselines")


def load(path: Path) -> dict[str, Estimate]:
    """Read the file that `save` wrote: the baseline of each joint; none if there is no such file.

    Raises:
        JointIdError: the file cannot be read or does not hold baselines.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise JointIdError(f"{path}: the file cannot be read: {error.strerror}") from None
    except ValueError as error:  # not JSON, or not even text
        raise JointIdError(f"{path}: not a JSON file: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT or not isinstance(content.get("joints"), dict):
        raise JointIdError(f'{path}: no baselines: "format" is not "{FORMAT}": name the file of ~/set_baseline')
    if not isinstance(version := content.get("version"), int) or version > VERSION:
        raise JointIdError(f"{path}: version {version}, this library reads up to {VERSION}: update joint_id")
    try:
        return {joint: Estimate.from_dict(estimate) for joint, estimate in content["joints"].items()}
    except JointIdError as error:
        raise JointIdError(f"{path}: {error}") from None
