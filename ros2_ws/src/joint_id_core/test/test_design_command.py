"""`joint-id design --joint`: from a robot's name to files and a promise, and `joint-id fit`, which proposes it."""

from __future__ import annotations

import html
import json
import shlex

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.design import plot, search
from joint_id_core.design.files import read_trajectory
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.models import build
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import ur_robot_sensors

LIMITS = """joint_limits:
  axis:
    {has_position_limits: true, min_position: -1.0, max_position: 1.0, has_velocity_limits: true, max_velocity: 2.0,
     has_acceleration_limits: true, max_acceleration: 10.0, has_jerk_limits: true, max_jerk: 200.0}
"""
QUICK = ("--time", "4", "--rate", "125")


@pytest.fixture
def few(monkeypatch):
    """A short search."""
    monkeypatch.setattr(search, "SHAPES", 3)
    monkeypatch.setattr(search, "STEPS", 2)


def test_a_robots_name_is_enough_and_the_files_say_the_same(tmp_path, run_here, few):
    code, out = run_here(
        "design", "--model", "rigid_joint", "--robot", "ur3e", "--joint", "elbow", *QUICK, "--set", "k_t=8.1",
        "--out", "motion.csv", "--out", "motion.yaml", "--out", "motion.script", "--plot", "motion.png",
    )  # fmt: skip
    assert code == 0, out
    assert "motion of elbow_joint: 4 s, 125 samples a second" in out and "verdict to expect" in out
    assert "nothing was sent to a robot" in out and "5 rad/s^2 is taken" in out
    one, other = (read_trajectory(tmp_path / f"motion.{kind}") for kind in ("csv", "yaml"))
    assert one.names == ("elbow_joint",) and np.allclose(one.position, other.position, atol=1e-9)
    assert "servoj" in (tmp_path / "motion.script").read_text()
    assert (tmp_path / "motion.png").read_bytes()[1:4] == b"PNG"
    code, said = run_here(
        "design", "--model", "rigid_joint", "--robot", "ur3e", "--joint", "elbow", "--rate", "125", "--set", "k_t=8.1",
        "--motion", "motion.csv", "--json",
    )  # fmt: skip
    assert code == 0, said
    told = {row["name"]: row for row in json.loads(said)["parameters"]}
    promised = {line.split()[0].partition(".")[2]: line.split() for line in out.splitlines() if "elbow_joint." in line}
    assert told["J"]["verdict"] == promised["J"][-1]
    assert told["J"]["std_dev"] == pytest.approx(float(promised["J"][2]), rel=0.06)


def test_a_file_of_limits_serves_any_joint(tmp_path, run_here, few):
    (tmp_path / "limits.yaml").write_text(LIMITS)
    code, out = run_here(
        "design", "--model", "rigid_joint", "--limits", "limits.yaml", "--joint", "axis", *QUICK, "--for", "J,tau_f",
        "--criterion", "A", "--home", "0.2", "--reach", "0.5", "--out", "m.csv",
    )  # fmt: skip
    assert code == 0, out
    motion = read_trajectory(tmp_path / "m.csv")
    assert motion.position[0, 0] == pytest.approx(0.2) and np.abs(motion.position - 0.2).max() <= 0.5
    assert np.abs(motion.velocity).max() <= 2.0 and np.abs(motion.acceleration).max() <= 10.0


def test_a_fit_proposes_a_design_that_can_be_pasted(tmp_path, run_here, few):
    """A slow motion shows little of a flexible joint; the command that is proposed for the rest runs as it is."""

    class Slow:
        def value(self, time):
            return 0.3 * np.sin(0.3 * time)

        def rate(self, time):
            return 0.09 * np.cos(0.3 * time)

    model = build("harmonic_drive", actuation="current")
    moved = simulate_closed_loop(model, PositionController(), Slow(), np.arange(800) / 250.0, {"k_t": 0.1})
    seen = ur_robot_sensors().measure(moved, 0, ["link_position", "motor_velocity", "current"])
    formats.write(tmp_path / "slow.csv", seen)
    code, out = run_here("fit", "slow.csv", "--model", "motor_side", "--set", "k_t=0.1", "--joint", "axis")
    line = next(line for line in out.splitlines() if line.startswith("a motion that shows more"))
    run_here("report", "slow.csv", "--model", "motor_side", "--set", "k_t=0.1", "--joint", "axis", "-o", "slow.html")
    assert f"<pre>{html.escape(line.partition(': ')[2])}</pre>" in (tmp_path / "slow.html").read_text()
    words = shlex.split(line.partition("joint-id ")[2])
    asked = words[words.index("--for") + 1].split(",")
    table = {line.split()[0]: line for line in out.splitlines() if " not_excited " in line}
    assert set(asked) == set(table) - {"tau_0"} and "k_t=0.1" in words
    (tmp_path / "joint_limits.yaml").write_text(LIMITS)
    code, out = run_here(*words, *QUICK)
    assert code == 0, out
    assert (tmp_path / "designed.csv").is_file() and "motion of axis: 4 s" in out


def test_a_fit_that_shows_everything_proposes_nothing(tmp_path, run_here):
    code, out = run_here("simulate", "rigid_joint", "--out", "motion.csv", "--rate", "250")
    code, out = run_here("fit", "motion.csv", "--model", "rigid_joint")
    assert code == 0 and "joint-id design" not in out


@pytest.mark.parametrize("name", ["elbow", "elbow_joint"])
def test_the_end_of_a_joints_name_may_be_left_out_where_the_file_has_it(tmp_path, run_here, few, name):
    """A joint called elbow was looked for as elbow_joint."""
    (tmp_path / "limits.yaml").write_text(LIMITS.replace("axis", name))
    words = ("design", "--joint", "elbow", "--limits", "limits.yaml", "--model", "rigid_joint", *QUICK)
    code, out = run_here(*words)
    assert code == 0 and f"motion of {name}: 4 s" in out, out


@pytest.mark.long
def test_a_motion_of_ones_own_is_held_against_the_limits(tmp_path, run_here, few):
    (tmp_path / "limits.yaml").write_text(LIMITS)
    words = ("design", "--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--time", "5")
    assert run_here(*words, "--out", "motion.csv")[0] == 0
    code, out = run_here(*words, "--motion", "motion.csv")
    assert code == 0 and "breaks a limit" not in out
    (tmp_path / "limits.yaml").write_text(LIMITS.replace("max_velocity: 2.0", "max_velocity: 0.1"))
    code, out = run_here(*words, "--motion", "motion.csv")
    assert code == 0 and "It breaks a limit: axis: velocity" in out and "limit 0.1 rad/s." in out


def test_a_recording_is_never_replaced_by_a_motion(tmp_path, run_here):
    run_here("simulate", "rigid_joint", "--out", "motion.csv", "--duration", "1")
    before = (tmp_path / "motion.csv").read_bytes()
    words = ("--joint", "elbow", "--robot", "ur3e", "--model", "rigid_joint", "--out", "motion.csv")
    code, out = run_here("design", *words)
    assert code == 2 and out == "joint-id: motion.csv exists already: remove it or choose another name\n"
    assert (tmp_path / "motion.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "say what shall move"),
        (("--joint", "axis"), "no limits are known: name a robot"),
        (("--joint", "elbow", "--robot", "ur20"), "no limits of a robot 'ur20' are known"),
        (("--joint", "knee", "--robot", "ur3e"), "ur3e has no such joint"),
        (("--joint", "elbow", "--robot", "ur3e"), "--joint needs --model"),
        (("--joint", "axis", "--limits", "none.yaml", "--model", "rigid_joint"), "none.yaml"),
        (("--joint", "axis", "--limits", "bad.yaml", "--model", "rigid_joint"), "leaves no room"),
        (("--joint", "axis", "--limits", "limits.yaml", "--model", "dc_motor"), "driven by a voltage"),
        (("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--for", "J,k"), "no parameter 'k'"),
        (("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--home", "x"), "--home x: give one"),
        (("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--time", "1"), "give 2 to 120 s"),
        (
            ("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--out", "limits.yaml"),
            "would overwrite a file that is read",
        ),
        (
            ("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "--out", "none/motion.csv"),
            "none/motion.csv: the trajectory cannot be written",
        ),
        (
            ("--joint", "axis", "--limits", "limits.yaml", "--model", "rigid_joint", "-o", "a.csv", "-o", "b.script"),
            "axis is no joint of a UR robot",
        ),
        (
            ("--joint", "elbow", "--robot", "ur3e", "--model", "rigid_joint", "--rate", "300", "--out", "b.script"),
            "300 samples a second: the period must be a multiple of 2 ms",
        ),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, run_here, words, said):
    (tmp_path / "limits.yaml").write_text(LIMITS)
    (tmp_path / "bad.yaml").write_text(LIMITS.replace("min_position: -1.0", "min_position: 3.0"))
    code, out = run_here("design", *words)
    assert code == 2 and said in out and len(out.splitlines()) == 1, out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.yaml", "limits.yaml"]


def test_a_file_of_limits_that_is_not_there_is_one_to_write(tmp_path, run_here, few):
    """The command that a fit proposes names joint_limits.yaml; the message shows what stands in it."""
    words = ("design", "--joint", "axis", "--model", "rigid_joint", "--limits", "joint_limits.yaml", "--time", "5")
    code, out = run_here(*words)
    assert code == 2 and "joint_limits.yaml: cannot be read" in out
    (tmp_path / "joint_limits.yaml").write_text(out.partition("write such a file: ")[2])
    code, out = run_here(*words)
    assert code == 0, out


def test_the_legend_of_the_picture_hides_no_curve(tmp_path, monkeypatch):
    """It lay over the first curves of six joints."""
    names = tuple(f"joint_{k}" for k in range(6))
    still = np.zeros((20, 6))
    drawn = []
    monkeypatch.setattr(plot, "written", lambda _, figure: drawn.append(figure))
    plot.save(tmp_path / "m.png", Trajectory(names, 0.1 * np.arange(20), still, still, still))
    (figure,) = drawn
    figure.canvas.draw()
    first = figure.axes[0]
    assert first.get_legend().get_window_extent().y0 >= first.get_window_extent().y1 - 1.0
