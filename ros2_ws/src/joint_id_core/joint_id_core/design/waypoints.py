"""Waypoints: poses of which a user knows that they, and the straight moves in joint space between neighbours, are free.

They are read from tables with a column a joint.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.formats.column_names import TIMES, UNITS, parts, without_unit
from joint_id_core.formats.csv_header import COMMENTS, cells, delimiter_of, is_number, lines

ALIKE = 1e-12  # by which directions of length 1 may differ that are one
COMMAS = (";", "\t")  # delimiters of tables whose numbers may have decimal commas
SUFFIX = "_joint"  # of the joints of a UR robot, which may be left out
OF_TRAJECTORY = "_position"  # after the joint's name in a trajectory that was written as CSV


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Poses in the order in which they are visited.

    Attributes:
        names: of the joints.
        points: rad (m for a joint that slides), shape (waypoints, joints).
        source: where they came from, for messages.

    Raises:
        JointIdError: a joint twice, wrong shapes, fewer than two waypoints, values that are not finite, waypoints that
            are all the same.
    """

    names: tuple[str, ...]
    points: Array
    source: str = "waypoints"

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=float)
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "points", points)
        if twice := [name for k, name in enumerate(self.names) if name in self.names[:k]]:
            raise JointIdError(f"{self.source}: two columns are of the joint {twice[0]}: keep one")
        if points.ndim != 2 or points.shape[1] != len(self.names):
            raise JointIdError(
                f"{self.source}: waypoints of shape {points.shape}: give a row for each, with {len(self.names)} joints"
            )
        if len(points) < 2:
            raise JointIdError(f"{self.source}: {_count(len(points))}: give two or more, between which the joints move")
        if (wrong := ~np.isfinite(points)).any():
            k, j = np.argwhere(wrong)[0]
            raise JointIdError(f"{self.source}: waypoint {k + 1} has {self.names[j]} = {points[k, j]}: give a number")
        if (points == points[0]).all():
            raise JointIdError(
                f"{self.source}: all {len(points)} waypoints are the same, so nothing moves: give at least two that "
                "differ"
            )

    @property
    def stops(self) -> NDArray[np.int64]:
        """Numbers of the waypoints at which the direction of the motion changes, and of both ends.

        One that is the same as that before it, or lies on the way from this one to the next one, is none.
        """
        kept = [0]
        for k in range(1, len(self.points)):
            way = self.points[k] - self.points[kept[-1]]
            if not way.any():
                continue
            if len(kept) > 1:
                before = self.points[kept[-1]] - self.points[kept[-2]]
                same = before / np.linalg.norm(before) - way / np.linalg.norm(way)
                if np.abs(same).max() < ALIKE:
                    kept.pop()
            kept.append(k)
        return np.array(kept)

    def of(self, joints: Sequence[str]) -> Waypoints:
        """Return the waypoints of these joints, in this order.

        Raises:
            JointIdError: a joint is missing, or there is one more.
        """
        names = tuple(_whole(name, joints) for name in self.names)
        if strange := [name for name in names if name not in joints]:
            raise JointIdError(
                f"{self.source}: {strange[0]} is no joint of the arm{close_to(strange[0], joints)}: it has "
                f"{', '.join(joints)}"
            )
        if missing := [name for name in joints if name not in names]:
            raise JointIdError(
                f"{self.source}: has no column of {', '.join(missing)}: give all joints of the arm, also those that "
                "stand"
            )
        return replace(self, names=tuple(joints), points=self.points[:, [names.index(name) for name in joints]])

    def of_one(self, joint: str) -> Waypoints:
        """Return the waypoints of one joint while all others stand.

        Raises:
            JointIdError: the joint is missing or stands, or another one moves: the ways would be others.
        """
        names = [_whole(name, (joint,)) for name in self.names]
        if joint not in names:
            raise JointIdError(
                f"{self.source}: has no column of {joint}{close_to(joint, names)}: it has {', '.join(self.names)}"
            )
        own = names.index(joint)
        moves = (self.points != self.points[0]).any(axis=0)
        if moving := [name for name, one in zip(names, moves, strict=True) if one and name != joint]:
            raise JointIdError(
                f"{self.source}: {moving[0]} moves, too, and a motion of {joint} alone would leave the ways between "
                "these waypoints: give some in which the other joints stand, or design for the whole arm (--arm)"
            )
        return replace(self, names=(joint,), points=self.points[:, own : own + 1])

    def require_within(self, limits: JointLimits) -> None:
        """Check that limits of these joints allow all waypoints.

        Raises:
            JointIdError: one of them is outside.
        """
        outside = (self.points < limits.lower) | (self.points > limits.upper)
        if outside.any():
            k, j = np.argwhere(outside)[0]
            raise JointIdError(
                f"{self.source}: waypoint {k + 1} has {self.names[j]} = {self.points[k, j]:g} rad, its limits are "
                f"{limits.lower[j]:g} to {limits.upper[j]:g} rad ({limits.source}): correct the waypoint or the limits"
            )


def read_waypoints(path: str | Path) -> Waypoints:
    """Read waypoints from a table: a first line with the names of the joints, then a line for each waypoint.

    Angles are in rad, or in degrees where a column is called so: `elbow_joint (deg)`, `elbow_joint_deg`. Names are
    those of the joints; `_position` may stand after them. Lines that begin with #, % or // are comments.

    Raises:
        JointIdError: the file cannot be read, has no names or is no table of numbers; see `Waypoints`.
    """
    path = Path(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        raise JointIdError(f"{path}: waypoints are read from a table (.csv) with a column for each joint")
    head, rows = _rows(path)
    names, factors = zip(*(_joint(path, name) for name in head), strict=True)
    points = np.empty((len(rows), len(head)))
    for k, (number, row) in enumerate(rows):
        if len(row) != len(head):
            raise JointIdError(f"{path}: line {number} has {len(row)} cells, the names are {len(head)}: mend this line")
        if wrong := [cell for cell in row if not is_number(cell)]:
            raise JointIdError(f"{path}: line {number}: {wrong[0]!r} is no number: write an angle with a decimal point")
        points[k] = [float(cell) for cell in row]
    return Waypoints(names, points * factors, str(path))


def _rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the names and, with their line numbers, the cells of the lines below them."""
    texts = [(n, line) for n, line in lines(path) if line.strip() and not line.strip().startswith(COMMENTS)]
    if not texts:
        raise JointIdError(f"{path}: holds no line: write the names of the joints, and below a line for each waypoint")
    first, delimiter = texts[0][1], delimiter_of(texts[0][1])
    rows = [(n, cells(line, delimiter)) for n, line in texts[1:]]
    if delimiter in COMMAS:
        rows = [(n, [cell.replace(",", ".") for cell in row]) for n, row in rows]
    one = delimiter is None and all(len(row) == 1 for _, row in rows)  # `elbow (deg)` is a name with a space
    head = [first.strip()] if one else cells(first, delimiter)
    if any(map(is_number, head)):
        raise JointIdError(f"{path}: line {texts[0][0]} holds numbers: put the names of the joints in a line above it")
    return head, rows


def _joint(path: Path, column: str) -> tuple[str, float]:
    """Return the joint of a column, and the factor that makes rad of its values."""
    name, unit = without_unit(column)
    if parts(column)[0] in TIMES:
        raise JointIdError(f"{path}: has a column {column!r}: waypoints have no times, which are searched: remove it")
    if not name or (unit and unit.lower() not in UNITS["rad"]):
        raise JointIdError(f"{path}: column {column!r}: name the joint, with (deg) if the angles are in degrees")
    return name.removesuffix(OF_TRAJECTORY), UNITS["rad"][unit.lower()] if unit else 1.0


def _whole(name: str, joints: Collection[str]) -> str:
    """Return the whole name of a joint, of which the end may be left out."""
    return name + SUFFIX if name not in joints and name + SUFFIX in joints else name


def _count(number: int) -> str:
    return "has no waypoint" if number == 0 else "has one waypoint"
