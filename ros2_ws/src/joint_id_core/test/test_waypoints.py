"""Motions through waypoints: they never leave the lines between them, keep all limits, and bad tables are refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.moves import inverse, step
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.waypoint_shapes import WaypointShapes, Ways
from joint_id_core.design.waypoints import Waypoints, read_waypoints
from joint_id_core.errors import JointIdError

SECONDS = 40.0


def limits(joints: int, jerk: float = 60.0) -> JointLimits:
    names = tuple(f"j{k}" for k in range(joints))
    return JointLimits(names, -3.0, 3.0, 2.0, 6.0, jerk, np.inf)  # type: ignore[arg-type]


def distance(q: Array, points: Array) -> Array:
    """Distance of poses (T, n) from the polyline through points (W, n), and where on it: share of its length (T,)."""
    nearest = np.full(len(q), np.inf)
    for one, other in pairwise(points):
        way = other - one
        along = np.clip((q - one) @ way / max(way @ way, 1e-300), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(q - one - along[:, None] * way, axis=1))
    return nearest


def visits(q: Array, points: Array) -> bool:
    """Whether all points are passed in their order, and then in the opposite one."""
    k = 0  # nearer than 1 mrad: a joint turns between samples
    for point in [*points, *points[-2::-1]]:
        near = np.flatnonzero(np.abs(q[k:] - point).max(axis=1) < 1e-3)
        if not len(near):
            return False
        k += int(near[0])
    return True


@st.composite
def searched(draw: st.DrawFn) -> tuple[WaypointShapes, Ways, Array, JointLimits, float]:
    """Waypoints of one to three joints, and a shape after some steps of a search."""
    joints, count = draw(st.integers(1, 3)), draw(st.integers(2, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = np.round(rng.uniform(-2.5, 2.5, (count, joints)), draw(st.integers(0, 6)))
    if (points == points[0]).all():
        points[-1] += 0.01
    own, rate = limits(joints, draw(st.sampled_from([20.0, 300.0]))), draw(st.sampled_from([50.0, 125.0]))
    shapes = WaypointShapes(Waypoints(own.names, points), own, SECONDS, rate)
    shape = shapes.random(rng)
    for _ in range(draw(st.integers(0, 6))):
        shape = shapes.changed(shape, draw(st.floats(0.05, 1.0)), rng)
    return shapes, shape, points, own, draw(st.sampled_from([1.0, 0.9]))


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(searched())
def test_a_motion_stays_on_the_lines_between_waypoints_and_keeps_its_limits(
    found: tuple[WaypointShapes, Ways, Array, JointLimits, float],
) -> None:
    shapes, shape, points, own, scale = found
    try:
        motion = shapes.trajectory(shape, scale)
    except JointIdError as error:
        assert scale < 1.0 and "come back in time" in str(error)
        return
    # also what a controller makes of the samples; where the joints turn back it may go on for some micrometres
    assert distance(motion.position, points).max() < 1e-9
    assert distance(motion.between(4).position, points).max() < 1e-5
    assert visits(motion.between(16).position, points)
    assert np.array_equal(motion.position[0], points[0]) and np.allclose(motion.position[-1], points[0], atol=1e-12)
    assert motion.duration == pytest.approx(SECONDS) and violations(motion, own) == ()


@settings(max_examples=30, deadline=None)
@given(st.floats(0.01, 0.5))
def test_the_step_of_a_speed_has_the_derivatives_that_it_tells(rise: float) -> None:
    y = np.linspace(0.0, 1.0, 20001)
    found = step(y, np.full(len(y), rise))
    assert np.allclose(found[:, [0, -1]].T, [[0.0, 0.0, 0.0, 0.0], [0.5, 1.0, 0.0, 0.0]], atol=1e-12)
    for lower, upper in pairwise(found):
        assert np.abs(np.gradient(lower, y) - upper)[1:-1].max() < 0.02 * np.abs(upper).max()
    assert np.abs(found[3]).max() == pytest.approx(1.5 * found[2].max() / rise, rel=1e-3)
    assert np.abs(inverse(found[1], np.full(len(y), rise)) - y).max() < 1e-3  # flat at both ends
    assert np.abs(step(inverse(found[1], np.full(len(y), rise)), np.full(len(y), rise))[1] - found[1]).max() < 1e-7


@settings(max_examples=30, deadline=None)
@given(searched())
def test_the_states_of_a_motion_are_derivatives_of_each_other(
    found: tuple[WaypointShapes, Ways, Array, JointLimits, float],
) -> None:
    shapes, shape, _, _, _ = found
    rate, state = shapes._rate, shapes.state(shape)
    for lower, upper in pairwise(state[:3]):
        rise = (upper[1:] + upper[:-1]) / 2.0 / rate
        assert np.abs(np.diff(lower, axis=0) - rise).max() < 0.1 * np.abs(upper).max() / rate


def test_a_joint_that_turns_back_does_not_stop_and_at_a_corner_it_does() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    own = limits(2)
    shapes = WaypointShapes(Waypoints(own.names, points), own, 20.0, 500.0)
    motion = shapes.trajectory(shapes.plain(2), 1.0)
    for point, turns in ((points[2], True), (points[1], False)):
        near = np.linalg.norm(motion.position - point, axis=1)
        k = int(np.argmin(near))
        assert near[k] < 1e-5
        assert (np.abs(motion.acceleration[k]).max() > 4.0) == turns


def test_the_fastest_move_reaches_a_limit() -> None:
    """Each of the three, by the length of the way and the jerk."""
    for length, jerk, kind in ((3.0, 500.0, "velocity"), (0.5, 500.0, "acceleration"), (0.05, 60.0, "jerk")):
        own = limits(1, jerk)
        points = np.array([[0.0], [length]])
        shapes = WaypointShapes(Waypoints(own.names, points), own, 20.0, 500.0)
        quick = Ways(np.array([[9.0] * 3, [0.0] * 3]), np.full((2, 2), np.nan))
        state = shapes.trajectory(quick, 1.0).between(4)
        assert np.abs(getattr(state, kind)).max() == pytest.approx(getattr(own, kind)[0], rel=0.04)
        assert shapes.sized(quick).held == kind


def test_a_smaller_share_of_the_speeds_drops_turns_and_then_rounds() -> None:
    own = limits(1)
    shapes = WaypointShapes(Waypoints(own.names, np.array([[0.0], [1.0]])), own, 20.0, 125.0)
    shape = shapes.random(np.random.default_rng(3))
    quick = Ways(np.zeros((2 * shapes.most, 3)), np.full((2 * shapes.most, 2), np.nan))
    slow = shapes.trajectory(quick, 0.4)
    assert np.abs(slow.velocity).max() < 0.55 * np.abs(shapes.trajectory(quick, 1.0).velocity).max()
    assert np.array_equal(shapes.trajectory(shape, 1.0).position, shapes.trajectory(shape, 1.0).position)
    with pytest.raises(JointIdError, match="come back in time"):
        shapes.trajectory(quick, 0.01)


def test_equal_neighbours_and_those_on_the_way_are_no_stops() -> None:
    own = limits(2)
    points = np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.25], [1.0, 0.5], [1.0, 0.5], [0.5, 0.25], [1.0, 0.0]])
    found = Waypoints(own.names, points)
    assert found.stops.tolist() == [0, 3, 5, 6]
    several, once = (
        WaypointShapes(Waypoints(own.names, rows), own, 20.0, 125.0) for rows in (points, points[found.stops])
    )
    shape = once.random(np.random.default_rng(0))
    assert np.array_equal(several.state(shape), once.state(shape))


def table(folder: Path, text: str) -> Path:
    path = folder / "poses.csv"
    path.write_text(text)
    return path


def test_tables_as_people_write_them(tmp_path: Path) -> None:
    found = read_waypoints(table(tmp_path, "# taught\nelbow_joint (deg),wrist_deg,lift\n90,180,0.5\n\n-45,0,1\n"))
    assert found.names == ("elbow_joint", "wrist", "lift")
    assert np.allclose(found.points, [[np.pi / 2, np.pi, 0.5], [-np.pi / 4, 0.0, 1.0]])
    one = read_waypoints(table(tmp_path, "elbow (deg)\n0\n90\n"))
    assert one.names == ("elbow",) and one.of_one("elbow_joint").names == ("elbow_joint",)
    other = read_waypoints(table(tmp_path, "a;b_position\n0,5;1\n1;2,5\n"))
    assert other.names == ("a", "b") and other.points.tolist() == [[0.5, 1.0], [1.0, 2.5]]


def test_joints_are_taken_by_name_and_none_moves_unseen() -> None:
    found = Waypoints(("b", "elbow", "a"), np.array([[0.0, 1.0, 2.0], [3.0, 1.0, 5.0]]))
    assert found.of(("a", "b", "elbow_joint")).points.tolist() == [[2.0, 0.0, 1.0], [5.0, 3.0, 1.0]]
    with pytest.raises(JointIdError, match="b moves, too, and a motion of a alone would leave the ways"):
        found.of_one("a")
    standing = replace(found, points=np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 5.0]]))
    assert standing.of_one("a").points.tolist() == [[2.0], [5.0]]
    with pytest.raises(JointIdError, match=r"elbo is no joint of the arm .did you mean elbow"):
        Waypoints(("elbo",), np.array([[0.0], [1.0]])).of(("elbow", "a"))
    with pytest.raises(JointIdError, match="has no column of c: give all joints"):
        found.of(("a", "b", "c", "elbow"))
    with pytest.raises(JointIdError, match="has no column of c: it has b, elbow, a"):
        found.of_one("c")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no line: write the names of the joints"),
        ("a,b\n", "has no waypoint: give two or more"),
        ("a,b\n1,2\n", "has one waypoint: give two or more"),
        ("a,b\n1,2\n1,2\n", "all 2 waypoints are the same, so nothing moves"),
        ("a,b\n1,2\n1,nan\n", "waypoint 2 has b = nan: give a number"),
        ("a,b\n1,2\n1,inf\n", "waypoint 2 has b = inf: give a number"),
        ("a,b\n1,2\n1,x\n", "line 3: 'x' is no number"),
        ("a,b\n1,2\n1,\n", "line 3: '' is no number"),
        ("a,b\n1,2\n1\n", "line 3 has 1 cells, the names are 2"),
        ("1,2\n3,4\n", "line 1 holds numbers: put the names of the joints in a line above it"),
        ("a,a\n1,2\n3,4\n", "two columns are of the joint a: keep one"),
        ("time,a\n1,2\n3,4\n", "has a column 'time': waypoints have no times"),
        ("a (Nm),b\n1,2\n3,4\n", "column 'a .Nm.': name the joint"),
    ],
)
def test_bad_tables_are_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(JointIdError, match=f"poses.csv: {said}"):
        read_waypoints(table(tmp_path, text))


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(JointIdError, match=r"none.csv: cannot be read"):
        read_waypoints(tmp_path / "none.csv")
    with pytest.raises(JointIdError, match="waypoints are read from a table"):
        read_waypoints(tmp_path / "poses.yaml")
    with pytest.raises(JointIdError, match=r"waypoints of shape .2,.: give a row for each, with 1 joints"):
        Waypoints(("a",), np.zeros(2))


def test_limits_and_time_are_held_before_anything_is_searched() -> None:
    own = limits(1)
    with pytest.raises(JointIdError, match=r"waypoint 2 has j0 = 3.5 rad, its limits are -3 to 3 rad"):
        WaypointShapes(Waypoints(own.names, np.array([[0.0], [3.5]]), "poses.csv"), own, 20.0, 125.0)
    with pytest.raises(
        JointIdError, match=r"there and back through 2 waypoints takes .* the motion has 1 s: give more"
    ):
        WaypointShapes(Waypoints(own.names, np.array([[0.0], [2.5]])), own, 1.0, 125.0)


def test_the_search_makes_a_trajectory() -> None:
    own = limits(2)
    shapes = WaypointShapes(Waypoints(own.names, np.array([[0.0, 0.0], [1.0, -1.0]])), own, 10.0, 125.0)
    assert isinstance(shapes.trajectory(shapes.random(np.random.default_rng(0)), 1.0), Trajectory)
