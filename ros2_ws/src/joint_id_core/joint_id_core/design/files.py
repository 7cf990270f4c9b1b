"""Trajectories as files: CSV, a `trajectory_msgs/JointTrajectory` as YAML, a URScript. Nothing is sent to a robot."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.urscript import urscript
from joint_id_core.errors import JointIdError
from joint_id_core.text_file import write_text

COLUMNS = ("position", "velocity", "acceleration")
_FIELD = {"position": "positions", "velocity": "velocities", "acceleration": "accelerations"}  # of the message
ENDINGS = {".csv": "CSV", ".yaml": "JointTrajectory", ".yml": "JointTrajectory", ".script": "URScript"}


def write(trajectory: Trajectory, path: str | Path, notes: Sequence[str] = ()) -> None:
    """Write a trajectory. The ending says how: .csv, .yaml (JointTrajectory) or .script (URScript for UR robots).

    Args:
        trajectory: the motion.
        path: of the file.
        notes: sentences that a URScript begins with, as comments.

    Raises:
        JointIdError: another ending, the file cannot be written, joints or a rate that no UR robot has (.script).
    """
    path = Path(path)
    kind = kind_of(path)
    makers = {"CSV": _csv, "JointTrajectory": _joint_trajectory}
    text = urscript(trajectory, notes) if kind == "URScript" else makers[kind](trajectory)
    write_text(path, text, "the trajectory")


def kind_of(path: Path) -> str:
    """Return what a trajectory is written as, by the ending of a path.

    Raises:
        JointIdError: another ending.
    """
    if (kind := ENDINGS.get(path.suffix.lower())) is None:
        raise JointIdError(f"{path}: a trajectory is written as {', '.join(ENDINGS)}: choose such an ending")
    return kind


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory that `write` made as CSV or YAML, or a JointTrajectory of other origin with all derivatives.

    Raises:
        JointIdError: the file cannot be read, is no trajectory, or its content is none (see `Trajectory`).
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise JointIdError(f"{path}: cannot be read ({reason}): give a trajectory as .csv or .yaml") from None
    kind = ENDINGS.get(path.suffix.lower())
    if kind not in ("CSV", "JointTrajectory"):
        raise JointIdError(f"{path}: a trajectory is read from .csv and .yaml")
    try:
        return _from_csv(text, path) if kind == "CSV" else _from_joint_trajectory(text, path)
    except JointIdError as error:
        raise JointIdError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _csv(trajectory: Trajectory) -> str:
    """Return the samples with a header: time, then position, velocity and acceleration of every joint."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(["time", *(f"{name}_{column}" for column in COLUMNS for name in trajectory.names)])
    values = np.column_stack([trajectory.time, trajectory.position, trajectory.velocity, trajectory.acceleration])
    table.writerows([[f"{value:.12g}" for value in row] for row in values.tolist()])
    return out.getvalue()


def _from_csv(text: str, path: Path) -> Trajectory:
    rows = list(csv.reader(io.StringIO(text)))
    head = rows[0] if rows else []
    names = tuple(name.removesuffix("_position") for name in head[1:] if name.endswith("_position"))
    wanted = ["time", *(f"{name}_{column}" for column in COLUMNS for name in names)]
    if not names or sorted(head) != sorted(wanted):
        raise JointIdError(
            f"{path}: no trajectory: its first row must name time, and position, velocity, acceleration of each joint "
            f"({', '.join(['time', *(f'JOINT_{column}' for column in COLUMNS)])})"
        )
    try:
        values = np.array([[float(value) for value in row] for row in rows[1:] if row]).reshape(-1, len(head))
    except ValueError:
        raise JointIdError(f"{path}: a row has another number of columns, or a value is no number") from None
    values = values[:, [head.index(name) for name in wanted]]
    return Trajectory(names, values[:, 0], *np.split(values[:, 1:], 3, axis=1))


def _joint_trajectory(trajectory: Trajectory) -> str:
    """Return a `trajectory_msgs/JointTrajectory`, one line a point."""
    lines = [
        "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
        f"joint_names: [{', '.join(repr(name) for name in trajectory.names)}]",
        "points:",
    ]
    for k, time in enumerate(trajectory.time.tolist()):
        sec, nanosec = divmod(round(time * 1e9), 10**9)
        fields = [f"{_FIELD[column]}: {_row(getattr(trajectory, column)[k])}" for column in COLUMNS]
        lines.append(f"- {{{', '.join(fields)}, effort: [], time_from_start: {{sec: {sec}, nanosec: {nanosec}}}}}")
    return "\n".join([*lines, ""])


def _row(values: Array) -> str:
    return f"[{', '.join(_plain(value) for value in values.tolist())}]"


def _plain(value: float) -> str:
    """Return a number that YAML 1.1 reads as one: 1e-05 would be a text."""
    text = f"{value:.12g}"
    mantissa, e, exponent = text.partition("e")
    return text if "." in mantissa else f"{mantissa}.0{e}{exponent}"


def _from_joint_trajectory(text: str, path: Path) -> Trajectory:
    import yaml

    try:
        content = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        raise JointIdError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from None
    try:
        points = content["points"]
        time = [_seconds(point["time_from_start"]) for point in points]
        columns = [np.array([point[_FIELD[column]] for point in points], dtype=float) for column in COLUMNS]
        names = tuple(str(name) for name in content["joint_names"])
    except (KeyError, TypeError, ValueError) as error:
        raise JointIdError(
            f"{path}: no JointTrajectory with joint_names and points of positions, velocities, accelerations and "
            f"time_from_start ({error})"
        ) from None
    return Trajectory(names, np.array(time), *columns)


def _seconds(stamp: Mapping[str, Any]) -> float:
    return int(stamp["sec"]) + int(stamp["nanosec"]) * 1e-9
