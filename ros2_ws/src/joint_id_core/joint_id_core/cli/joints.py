"""The fits of several joints as a table, or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from joint_id_core.jobs.fit_job import Result


def joints_table(results: Mapping[str, Result | str]) -> str:
    """Return a table with a row a joint: status, and the estimated parameters."""
    from joint_id_core.results.report import beside_others, estimated

    width = max(len("joint"), *map(len, results)) + 2
    lines = [f"  {'joint':<{width}}{'model':<22}{'status':<16}parameters"]
    told: dict[str, str] = {}  # what is wrong
    for joint, result in results.items():
        if isinstance(result, str):
            lines.append(f"  {joint:<{width}}{'-':<22}{'not fitted':<16}")
            told[joint] = result
            continue
        estimate = result.estimate
        gravity = " gravity" if estimate.model_options.get("gravity") else ""
        lines.append(
            f"  {joint:<{width}}{estimate.model + gravity:<22}{estimate.status.value:<16}{estimated(estimate) or '-'}"
        )
        if not estimate.converged:
            told[joint] = beside_others(estimate, estimate.message)
    return "\n".join([*lines, *([""] if told else []), *remarks(told)])


def remarks(told: Mapping[str, str]) -> list[str]:
    """Return what is said of joints as lines; what is said of several stands there once."""
    also: dict[str, list[str]] = {}
    for joint, text in told.items():
        also.setdefault(text, []).append(joint)
    return [f"  {', '.join(joints)}: {text}" for text, joints in also.items()]


def at_once(files: Sequence[Path], mapping: Mapping[str, str]) -> str:
    """Return what to do if joints of the first file move at the same time; "" if they do not."""
    from joint_id_core import formats
    from joint_id_core.checking.others import others_move
    from joint_id_core.data.recording import Recording

    found = formats.read_joints(files[0], mapping).recordings.values()
    read = [recording for recording in found if isinstance(recording, Recording)]
    if not any(any(others_move(recording, read)) for recording in read):
        return ""
    again = shlex.join(["joint-id", "arm", "fit", "robot.urdf", *map(str, files)])
    return (
        "\njoints move at the same time, so each feels the load of the others; with the robot's description it is "
        f"known: --urdf robot.urdf, or all at once: {again}"
    )


def joints_json(results: Mapping[str, Result | str]) -> list[dict[str, Any]]:
    """Return the results as plain JSON types, an entry a joint."""
    return [
        {"joint": joint, "error": result} if isinstance(result, str) else {"joint": joint, **result.estimate.to_dict()}
        for joint, result in results.items()
    ]
