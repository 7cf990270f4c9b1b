"""The motion of an arm through waypoints that tells the most within its limits: the search of `evolution`.

What a shape tells is that of `arm_information`. Limits of torque, and a floor, are looked at on the straight lines
between the waypoints before the search, which leaves to it the speeds and the turns alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.arm_motion import FLOOR_HZ, LEAST, ROOM, STEP, Task, broken
from joint_id_core.design.evolution import drawn, evolved
from joint_id_core.design.moves import Pace
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.waypoint_shapes import WaypointShapes, Ways
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.errors import JointIdError
from joint_id_core.options import Progress

STARTS, STEPS = 100, 500  # random shapes, and steps from the best one
INSTANTS = 20.0  # in a second, at which information is computed
PLACES = 25  # on each way, at which torques are computed
HALVINGS = 12  # of the interval in which the share of the speeds is looked for that torques allow


@dataclass(frozen=True)
class Told:
    """A shape and how much it tells."""

    shape: Ways
    told: float


def motion_through(
    task: Task, waypoints: Waypoints, seed: int = 0, progress: Progress = lambda _: None
) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the motion that tells the most, and in sentences how it goes through the waypoints.

    Args:
        task: what is asked; its home says nothing.
        waypoints: of the joints of the arm, in the order of its limits.
        seed: of the shapes from which the search begins.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: limits that do not let the arm stand at a waypoint or between two, or move there in time.
    """
    waypoints.require_within(task.limits)
    shapes = WaypointShapes(waypoints, task.limits, task.duration, task.rate, _shares(task, waypoints))
    some = np.unique(np.linspace(0, round(task.duration * task.rate), round(task.duration * INSTANTS)).astype(int))

    def better(shape: Ways, best: Told | None) -> Told:
        q, dq, ddq, _ = shapes.state(shape, 1.0, some)
        told = task.chosen.told(task.columns.information(task.columns.at(q, dq, ddq))[0])[0]
        return Told(shape, told) if best is None or told > best.told else best

    rng = np.random.default_rng(seed)
    best = drawn(shapes, better, STARTS, rng, lambda k: progress(f"motion {k} of {STARTS + STEPS}"))
    assert best is not None
    best = evolved(
        shapes, best, better, STEPS, rng, lambda k: progress(f"motion {STARTS + int(k)} of {STARTS + STEPS}")
    )
    scale, step = 1.0, STEP
    trajectory = shapes.trajectory(best.shape, scale)
    while found := broken(trajectory, task):  # between the places that were looked at
        scale, step = scale - step, 1.5 * step
        if scale < LEAST:
            raise JointIdError(f"no motion through {waypoints.source} keeps the limits ({found}): choose others")
        trajectory = shapes.trajectory(best.shape, scale)
    return trajectory, shapes.told(best.shape, scale)


def _shares(task: Task, waypoints: Waypoints) -> Array:
    """Return the share of the pace of the limits that torques allow on each way between two stops."""
    limits, points, numbers = task.limits, waypoints.points[waypoints.stops], waypoints.stops + 1
    ways = np.diff(points, axis=0)
    length = np.linalg.norm(ways, axis=1)
    pace, shares = Pace.of(ways / length[:, None], limits), np.ones(len(ways))
    speed = pace.alone(length)
    for k, way in enumerate(ways):
        between = f"between waypoints {numbers[k]} and {numbers[k + 1]} of {waypoints.source}"
        q = points[k] + np.linspace(0.0, 1.0, PLACES)[:, None] * way
        over = task.torque(q, 0.0 * q, 0.0 * q) / (ROOM * limits.torque)
        if over.max() > 1.0:
            j = int(np.argmax(over.max(axis=0)))
            raise JointIdError(
                f"{between} {limits.names[j]} needs up to {ROOM * limits.torque[j] * over.max():.3g} Nm to stand, its "
                f"limit is {limits.torque[j]:g} Nm: choose others, or correct limits and description"
            )
        if task.floor is not None:
            count = max(2, round(FLOOR_HZ * length[k] / speed[k]) + 1)
            low = task.floor(points[k] + np.linspace(0.0, 1.0, count)[:, None] * way)[0]
            if low.max() > 0.0:
                raise JointIdError(f"{between} the arm is {low.max():.3g} m too low: choose others, or another --floor")
        shares[k] = _share(task, q, way / length[k], speed[k], pace.acceleration[k])
    return shares


def _share(task: Task, q: Array, direction: Array, speed: float, acceleration: float) -> float:
    """Return the share of the pace of a way at which torques keep their limits, at poses (T, n) of it."""
    rates, changes = np.meshgrid(speed * np.linspace(-1.0, 1.0, 5), acceleration * np.array([-1.0, 1.0]))

    def holds(share: float) -> bool:
        dq = share * rates.ravel()[:, None] * direction
        ddq = share**2 * changes.ravel()[:, None] * direction
        count = len(dq)
        states = np.repeat(q, count, axis=0), np.tile(dq, (len(q), 1)), np.tile(ddq, (len(q), 1))
        return bool((task.torque(*states) <= ROOM * task.limits.torque).all())

    low, high = 0.0, 1.0
    if holds(high):
        return high
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if holds(middle) else (low, middle)
    return max(low, 2.0**-HALVINGS)
