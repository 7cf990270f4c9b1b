"""`joint-id design --waypoints`: what it makes for one joint and for an arm, what it promises, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.design import search
from joint_id_core.design.files import read_trajectory
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.joint import design_joint, foretell
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.waypoint_shapes import WaypointShapes
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.results.verdict import Verdict

RATE, SECONDS = 125.0, 12.0
MODEL = build("rigid_joint")
LIMITS = JointLimits(("axis",), -2.0, 2.0, 2.0, 10.0, 200.0, 60.0, "test")  # type: ignore[arg-type]
POSES = Waypoints(("axis",), np.array([[0.2], [1.0], [-0.5]]), "poses.csv")
YAML = """joint_limits:
  axis: {min_position: -2.0, max_position: 2.0, max_velocity: 2.0, max_acceleration: 10.0, max_jerk: 200.0}
"""
OF_AXIS = ("design", "--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--rate", "125")


@pytest.fixture(scope="module")
def design():
    return design_joint(MODEL, LIMITS, time=SECONDS, rate=RATE, waypoints=POSES)


def test_it_goes_where_the_waypoints_are_and_says_so(design):
    motion, said = design.trajectory, " ".join(design.notes)
    assert motion.position.min() >= -0.5 - 1e-12 and motion.position.max() <= 1.0 + 1e-12
    assert motion.position[0, 0] == 0.2 and motion.position[-1, 0] == pytest.approx(0.2, abs=1e-12)
    assert np.abs(motion.position - 1.0).min() < 1e-3 and np.abs(motion.position + 0.5).min() < 1e-3
    assert motion.duration == SECONDS
    assert (
        "through the waypoints of poses.csv and back" in said and "that these are free of collisions only you" in said
    )
    assert "The limit of" in said and "holds this motion (test)" in said
    assert {row.name for row in design.shown} >= {"J", "c", "tau_f"}
    again = design_joint(MODEL, LIMITS, time=SECONDS, rate=RATE, waypoints=POSES)
    assert np.array_equal(again.trajectory.position, motion.position)


@pytest.mark.long
def test_it_beats_the_same_waypoints_at_one_speed(design):
    foresight = Foresight(MODEL, ParameterSettings(), RATE)
    shapes = WaypointShapes(POSES, LIMITS, SECONDS, RATE)

    def mean(of):
        return np.exp(np.mean([np.log(r.std_dev / r.value) for r in of.expected if r.name in ("J", "c", "tau_f")]))

    plain = [
        mean(foretell(foresight, shapes.trajectory(shapes.plain(n), 1.0, "axis"))) for n in range(1, shapes.most + 1)
    ]
    assert mean(design) < 0.9 * min(plain)


@pytest.fixture
def few(monkeypatch):
    """A short search."""
    monkeypatch.setattr(search, "SHAPES", 3)
    monkeypatch.setattr(search, "STEPS", 2)


@pytest.mark.long
def test_a_limit_of_torque_makes_it_slower(few):
    foresight = Foresight(MODEL, ParameterSettings(), RATE)
    joint = foresight.joints(0)[0]

    def torque(limits):
        motion = design_joint(MODEL, limits, time=6.0, rate=RATE, waypoints=POSES).trajectory
        return foresight.move(joint, motion.position[:, 0].copy(), motion.velocity[:, 0].copy()).torque

    weak = replace(LIMITS, torque=np.array([0.7 * torque(LIMITS)]))
    assert 0.5 * weak.torque[0] < torque(weak) <= weak.torque[0]


def test_what_waypoints_cannot_show_is_told(few):
    slow = replace(LIMITS, velocity=np.array([0.1]), acceleration=np.array([0.05]))
    near = Waypoints(("axis",), np.array([[0.0], [0.1]]))
    found = design_joint(MODEL, slow, ParameterSettings(priors={"J": 0.01}), time=8.0, rate=RATE, waypoints=near)
    row = next(row for row in found.expected if row.name == "J")
    assert row.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR) and row.reason


def test_a_table_of_degrees_is_enough(tmp_path, run_here, few):
    (tmp_path / "limits.yaml").write_text(YAML)
    (tmp_path / "poses.csv").write_text("axis (deg),other (deg)\n0,5\n45,5\n-30,5\n")
    code, out = run_here(*OF_AXIS, "--time", "8", "--waypoints", "poses.csv", "-o", "m.csv", "-o", "m.yaml")
    assert code == 0, out
    assert "through the waypoints of poses.csv and back" in out and "verdict to expect" in out
    motion = read_trajectory(tmp_path / "m.csv")
    assert motion.names == ("axis",) and motion.duration == 8.0
    assert np.degrees(motion.position.max()) == pytest.approx(45.0, abs=0.01)
    assert np.degrees(motion.position.min()) == pytest.approx(-30.0, abs=0.01)
    assert np.allclose(read_trajectory(tmp_path / "m.yaml").position, motion.position, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--waypoints", "none.csv"), "none.csv: cannot be read"),
        (
            ("--waypoints", "poses.csv", "--motion", "poses.csv"),
            "--waypoints and --motion both say where the motion goes",
        ),
        (("--waypoints", "poses.csv", "--home", "0"), "--waypoints and --home both say where the motion goes"),
        (("--waypoints", "poses.csv", "--reach", "1"), "--waypoints and --reach both say where the motion goes"),
        (("--waypoints", "other.csv"), "other.csv: has no column of axis (did you mean axes?): it has axes"),
        (("--waypoints", "both.csv"), "both.csv: lift moves, too, and a motion of axis alone would leave the ways"),
        (("--waypoints", "far.csv"), "far.csv: waypoint 2 has axis = 3 rad, its limits are -2 to 2 rad (limits.yaml)"),
        (
            ("--waypoints", "poses.csv", "--time", "2"),
            "and the motion has 2 s: give more time (--time), fewer or nearer",
        ),
        (("--waypoints", "poses.csv", "--out", "poses.csv"), "would overwrite a file that is read"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, run_here, words, said):
    files = {
        "limits.yaml": YAML, "poses.csv": "axis\n0\n1\n-1\n1.5\n-1.5\n", "other.csv": "axes\n0\n1\n",
        "both.csv": "axis,lift\n0,0\n1,1\n", "far.csv": "axis\n0\n3\n",
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    code, out = run_here(*OF_AXIS, *words)
    assert code == 2 and said in out and len(out.splitlines()) == 1, out
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == files


def test_limits_of_several_joints_are_refused():
    with pytest.raises(JointIdError, match="give those of one joint"):
        design_joint(MODEL, JointLimits.none(("a", "b")), rate=RATE, waypoints=POSES)
