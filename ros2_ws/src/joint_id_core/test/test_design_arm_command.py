"""`joint-id design --arm`: files to start, what it prints, and what it refuses."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.design import arm_waypoints
from joint_id_core.design.files import read_trajectory, write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.limit_files import read_limits
from joint_id_core.design.limits import violations

from .moving_arm import JOINTS, URDF

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")

HOME = "0,-1.2,1.2,-1,-1,0"
LIMITS = "joint_limits:\n" + "".join(
    f"  {name}: {{min_position: -2, max_position: 2, max_velocity: 2, max_acceleration: 5, max_effort: {effort}}}\n"
    for name, effort in zip(JOINTS, (110, 80, 45, 12, 8, 8), strict=True)
)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    urdf, limits = tmp_path / "arm.urdf", tmp_path / "limits.yaml"
    urdf.write_text(URDF)
    limits.write_text(LIMITS)
    return urdf, limits


def run(*arguments: object) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["design", *map(str, arguments)])
    return found.exit_code, found.output


def test_a_motion_is_designed_written_and_foretold_again(files: tuple[Path, Path], tmp_path: Path) -> None:
    urdf, limits = files
    csv, yaml, plot = (tmp_path / f"motion.{ending}" for ending in ("csv", "yaml", "png"))
    asked = ("--arm", urdf, "--limits", limits, "--home", HOME, "--time", 8, "--rate", 125)
    code, text = run(*asked, "-o", csv, "-o", yaml, "--plot", plot)
    assert code == 0 and plot.exists()
    for words in (
        "damping",
        "combination",
        "Collisions were NOT checked",
        "as of a UR10e",
        "jerk is given",
        "csv: look",
    ):
        assert words in text, words
    motion = read_trajectory(csv)
    assert np.allclose(read_trajectory(yaml).position, motion.position, atol=1e-9)
    assert motion.names == JOINTS and motion.duration == 8.0 and motion.rate == pytest.approx(125.0)
    assert not violations(motion, read_limits(limits, JOINTS))
    code, again = run("--arm", urdf, "--limits", limits, "--motion", csv)
    table = text[text.index("  joint ") : text.index("  torque: that")]
    assert code == 0 and again[again.index("  joint ") : again.index("  torque: that")] == table
    code, told = run("--arm", urdf, "--limits", limits, "--motion", csv, "--json")
    content = json.loads(told)
    rows = content["parameters"]
    assert 1.0 < content["condition_number"] < 1e3
    assert code == 0 and len(rows) == 18 + 40 and {row["joint"] for row in rows} == {*JOINTS, ""}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"--home": "0,1"}, "give one number for each of turn, lift"),
        ({"--home": HOME, "--joint": "turn"}, "say what shall move"),
        ({"--home": HOME, "--model": "rigid_joint"}, "--model says nothing of a whole arm"),
        ({"--home": HOME, "--for": "mass"}, "known are friction, rotors, links"),
        ({"--home": HOME, "--criterion": "E"}, "choose one of sigma, D, A"),
        ({"--home": HOME, "--fit": "none.json"}, "cannot be read"),
        ({"--home": HOME, "--robot": "ur3e"}, "no limits of the joint turn"),
        ({"--home": HOME, "--floor": "2"}, "m too low"),
        ({"--home": HOME, "-o": "motion.txt"}, "choose such an ending"),
        ({"--limits": None}, "joint turn has no limit of torque"),
        ({"--home": HOME, "--motion": "none.csv"}, "none.csv: cannot be read"),
    ],
)
def test_bad_input(files: tuple[Path, Path], changes: dict[str, str | None], text: str) -> None:
    asked = {"--arm": str(files[0]), "--limits": str(files[1]), "--time": "6", "--rate": "50", **changes}
    code, told = run(*(part for option, value in asked.items() if value is not None for part in (option, value)))
    assert code == 2 and text in " ".join(told.split())


def test_a_motion_of_one_joint_is_none_of_the_arm(files: tuple[Path, Path], tmp_path: Path) -> None:
    """It says nothing of where the others are; it ended in a traceback."""
    urdf, limits = files
    write(FourierMotion(("lift",), [0.0], [[0.1]], [[0.2]], [0.5], 8.0, 1.0).sampled(125.0), tmp_path / "lift.csv")
    code, text = run("--arm", urdf, "--limits", limits, "--motion", tmp_path / "lift.csv")
    assert code == 2 and "moves lift and does not tell where turn, bend, roll, tilt, spin" in " ".join(text.split())


def poses(folder: Path, third: str = "20,-50,40,-50,-80,20") -> Path:
    """Waypoints of the arm, in degrees, in another order than that of its description."""
    path = folder / "poses.csv"
    rows = ("0,-70,70,-60,-60,0", "-30,-90,90,-30,-20,-40", third)
    turned = [",".join(reversed(row.split(","))) for row in rows]
    path.write_text("\n".join([",".join(f"{name} (deg)" for name in reversed(JOINTS)), *turned, ""]))
    return path


def test_an_arm_goes_through_waypoints(files: tuple[Path, Path], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(arm_waypoints, "STARTS", 10)
    monkeypatch.setattr(arm_waypoints, "STEPS", 20)
    urdf, limits = files
    path, csv = poses(tmp_path), tmp_path / "motion.csv"
    asked = ("--arm", urdf, "--limits", limits, "--time", 12, "--rate", 125)
    code, text = run(*asked, "--waypoints", path, "-o", csv)
    assert code == 0, text
    said = " ".join(text.split())
    assert "through the waypoints of" in said and "free of collisions only you know" in said
    motion = read_trajectory(csv)
    assert motion.names == JOINTS and not violations(motion, read_limits(limits, JOINTS))
    points = np.radians([[0, -70, 70, -60, -60, 0], [-30, -90, 90, -30, -20, -40], [20, -50, 40, -50, -80, 20]])
    off = np.full(len(motion.position), np.inf)
    for one, other in pairwise(points):
        way = other - one
        along = np.clip((motion.position - one) @ way / (way @ way), 0.0, 1.0)
        off = np.minimum(off, np.abs(motion.position - one - along[:, None] * way).max(axis=1))
    assert off.max() < 1e-8
    for point in points:
        assert np.abs(motion.position - point).max(axis=1).min() < 1e-3


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"third": "20,-50,40,-50,-80,200"}, "waypoint 3 has spin = 3.49066 rad, its limits are -2 to 2 rad"),
        ({"third": "20,-50,nan,-50,-80,20"}, "waypoint 3 has bend = nan: give a number"),
        ({"--floor": "0.9"}, "between waypoints 1 and 2 of"),
        ({"--time": "5", "third": "110,-110,40,110,-80,110"}, "and the motion has 5 s: give more time (--time)"),
        ({"--home": HOME}, "--waypoints and --home both say where the motion goes"),
    ],
)
def test_waypoints_that_an_arm_cannot_pass(
    files: tuple[Path, Path], tmp_path: Path, changes: dict[str, str], text: str
) -> None:
    options = {name: value for name, value in changes.items() if name != "third"}
    path = poses(tmp_path, changes.get("third", "20,-50,40,-50,-80,20"))
    asked = {"--arm": files[0], "--limits": files[1], "--time": "10", "--rate": "125", "--waypoints": path, **options}
    code, told = run(*(part for pair in asked.items() for part in pair))
    assert code == 2 and text in " ".join(told.split()), told


def test_waypoints_at_which_a_joint_is_too_weak(files: tuple[Path, Path], tmp_path: Path) -> None:
    urdf, limits = files
    limits.write_text(LIMITS.replace("max_effort: 80", "max_effort: 8"))
    code, told = run("--arm", urdf, "--limits", limits, "--waypoints", poses(tmp_path), "--time", 10)
    assert code == 2 and "lift needs up to" in told and "to stand, its limit is 8 Nm" in " ".join(told.split())
