"""Trajectories, Fourier motions and limits: derivatives by finite differences, refusals, and what is found between."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from joint_id_core.design.design import Design, Expected, verdict_of
from joint_id_core.design.fourier import FourierMotion, window
from joint_id_core.design.limit_files import published, read_limits
from joint_id_core.design.limits import ACCELERATION, RISE_S, JointLimits, violations
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import Verdict

NAMES = ("one", "two")


def motion(duration: float = 4.0) -> FourierMotion:
    rng = np.random.default_rng(3)
    cosines, sines = rng.normal(0.0, 0.2, (2, 2, 3))
    return FourierMotion(NAMES, np.array([0.3, -1.0]), cosines, sines, np.array([0.5, 1.0, 2.5]), duration, 0.8)


def limits(**kinds: float) -> JointLimits:
    return replace(JointLimits.none(NAMES), **{kind: np.full(2, value) for kind, value in kinds.items()})


def test_derivatives_are_those_of_the_position() -> None:
    step = 1e-4
    time = np.arange(0.0, 4.0, step)
    state = motion().at(time)
    for lower, upper in pairwise(state):
        assert np.abs(np.gradient(lower, step, axis=0) - upper)[1:-1].max() < 1e-4 * np.abs(upper).max()


def test_motion_starts_and_ends_at_home_at_rest_without_a_jump_of_the_jerk() -> None:
    state = motion().at(np.array([0.0, 4.0]))
    assert np.allclose(state.position, motion().home, atol=1e-12)
    assert max(float(np.abs(part).max()) for part in state[1:]) < 1e-9


def test_the_window_is_one_between_the_ramps() -> None:
    soft = window(np.array([0.8, 2.0, 3.2]), 4.0, 0.8)
    assert np.allclose(soft[0], 1.0) and np.allclose(soft[1:], 0.0, atol=1e-9)


def test_between_the_samples_lies_the_motion_itself() -> None:
    trajectory = motion().sampled(100.0)
    time = np.linspace(0.0, 4.0, 1237)
    found, true = trajectory.at(time), motion().at(time)
    for name, share in (("position", 1e-8), ("velocity", 1e-6), ("acceleration", 1e-4), ("jerk", 1e-2)):
        error = np.abs(getattr(found, name) - getattr(true, name)).max()
        assert error < share * np.abs(getattr(true, name)).max(), name
    at_samples = trajectory.at(trajectory.time)
    assert np.allclose(at_samples.acceleration, trajectory.acceleration, atol=1e-9)


def changed(**parts: object) -> Trajectory:
    good = motion().sampled(50.0)
    return replace(good, **parts)


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        ({"names": ("one", "one")}, "name each joint once"),
        ({"names": ("one",)}, "201 samples of 1 joints are needed"),
        ({"velocity": np.degrees(motion().sampled(50.0).velocity)}, "velocity of two is not the derivative"),
        ({"acceleration": -motion().sampled(50.0).acceleration}, "acceleration of two is not the derivative"),
        ({"time": motion().sampled(50.0).time + 1.0}, "must begin at 0"),
        ({"time": motion().sampled(50.0).time ** 2}, "not evenly spaced"),
        ({"position": np.full((201, 2), np.nan)}, "position of one at sample 0 is nan"),
        ({"velocity": motion().sampled(50.0).velocity + 0.1}, "at the start: a motion starts and ends at rest"),
    ],
)
def test_what_is_no_trajectory_is_refused(parts: dict[str, object], text: str) -> None:
    with pytest.raises(JointIdError, match=text):
        changed(**parts)


def test_a_coarse_trajectory_passes_its_own_check() -> None:
    fast = FourierMotion(("j",), np.zeros(1), np.ones((1, 1)), np.zeros((1, 1)), np.array([3.0]), 4.0, 1.0)
    assert fast.sampled(20.0).rate == pytest.approx(20.0)


def test_violations_are_found_between_the_samples() -> None:
    """At 4 samples a period the samples of a velocity miss its peak, which the quintic between them has."""
    wave = FourierMotion(("one",), np.zeros(1), np.zeros((1, 1)), np.ones((1, 1)), np.array([1.0]), 8.125, 1.0)
    peak = float(np.abs(wave.at(np.linspace(0.0, 8.125, 10001)).position).max())
    one = JointLimits.none(("one",))
    shifted = replace(wave, cosines=np.full((1, 1), math.sin(0.39)), sines=np.full((1, 1), math.cos(0.39)))
    coarse = shifted.sampled(8.0)
    at_samples = float(np.abs(coarse.position).max())
    assert at_samples < 0.95 * peak
    between = (at_samples + peak) / 2.0
    found = violations(coarse, replace(one, lower=np.full(1, -between), upper=np.full(1, between)))
    assert len(found) == 1 and "one: position" in found[0]


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk"])
def test_each_limit_is_held(kind: str) -> None:
    trajectory = motion().sampled(125.0)
    largest = np.abs(getattr(trajectory.between(8), kind)).max(axis=0)
    wide = replace(JointLimits.none(NAMES), **{kind: largest * 1.0001})
    tight = replace(JointLimits.none(NAMES), **{kind: largest * 0.999})
    assert violations(trajectory, wide) == ()
    assert [text.split(":")[0] for text in violations(trajectory, tight)] == ["one", "two"]
    assert all(kind in text for text in violations(trajectory, tight))


def test_torque_is_held_where_it_is_known() -> None:
    trajectory = motion().sampled(125.0)
    found = violations(trajectory, limits(torque=1.0), lambda q, v, a: 2.0 * np.ones_like(q))
    assert len(found) == 2 and "torque 2 Nm" in found[0]
    assert violations(trajectory, limits(torque=1.0)) == ()


def test_limits_that_contradict_are_refused() -> None:
    with pytest.raises(JointIdError, match="joint one may go from 1 to -1 rad"):
        limits(lower=1.0, upper=-1.0)
    with pytest.raises(JointIdError, match="velocity = -1: give a number above 0"):
        limits(velocity=-1.0)


def test_what_no_limit_says_is_said() -> None:
    full, notes = limits(lower=-1.0, upper=1.0, velocity=1.0).completed()
    assert full.acceleration.tolist() == [ACCELERATION] * 2 and full.jerk.tolist() == [ACCELERATION / RISE_S] * 2
    assert len(notes) == 3 and "No limit of torque" in notes[2]
    with pytest.raises(JointIdError, match="joint one has no limit of position"):
        limits(velocity=1.0).completed()


def test_limits_that_seem_to_be_in_degrees_are_told() -> None:
    _, notes = limits(lower=-180.0, upper=170.0, velocity=90.0, acceleration=1.0, jerk=10.0, torque=1.0).completed()
    assert len(notes) == 4 and "one has the limit position = 180 rad: if it is in degrees" in notes[0]
    assert "two has the limit velocity = 90 rad/s: if it is in degrees, write it in SI units" in notes[3]


URDF = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/>
<limit lower="-2" upper="2.5" velocity="3" effort="40"/></joint>
<joint name="two" type="continuous"><parent link="b"/><child link="c"/>
<limit velocity="2" effort="0"/></joint></robot>"""


def test_limits_of_a_urdf_and_what_a_file_adds(tmp_path: Path) -> None:
    urdf, file = tmp_path / "r.urdf", tmp_path / "limits.yaml"
    urdf.write_text(URDF)
    found = read_limits(urdf, NAMES)
    assert (found.lower[0], found.upper[0], found.velocity[0], found.torque[0]) == (-2.0, 2.5, 3.0, 40.0)
    assert math.isinf(found.upper[1]) and math.isinf(found.torque[1]) and found.velocity[1] == 2.0
    file.write_text(
        "joint_limits:\n  two:\n    has_position_limits: true\n    min_position: !degrees -90\n    max_position: 1.5\n"
        "    max_velocity: 1e-1\n    has_acceleration_limits: false\n    max_acceleration: 0\n    max_jerk: 30\n"
    )
    both = read_limits(file, NAMES, found)
    assert (both.lower[1], both.upper[1], both.jerk[1]) == (pytest.approx(-math.pi / 2.0), 1.5, 30.0)
    assert both.velocity[1] == 0.1 and math.isinf(both.acceleration[1]) and both.torque[0] == 40.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint_limits: 3", "holds no limits"),
        ("joint_limits: {one: {max_velocty: 1.0}}", "did you mean max_velocity"),
        ("joint_limits: {one: {max_velocity: fast}}", "'fast': give a number"),
        ("joint_limits: {one: {has_velocity_limits: true}}", "max_velocity is missing"),
        ("joint_limits: {one: {min_position: 1, max_position: 0}}", "leaves no room"),
        ("joint_limits: {other: {max_velocity: 1}}", "holds no limits of one, two: it has other"),
        ("joint_limits: {one: [", "cannot be read as YAML"),
    ],
)
def test_bad_files_of_limits(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(text)
    with pytest.raises(JointIdError, match=message):
        read_limits(file, NAMES)


def test_published_limits() -> None:
    found = published("ur3e").of(["elbow_joint"])
    assert (found.upper[0], found.velocity[0], found.torque[0]) == (math.pi, math.pi, 28.0)
    with pytest.raises(JointIdError, match="did you mean ur3e"):
        published("ur3")


def test_a_design_says_what_it_shows() -> None:
    rows = (
        Expected("one", "c", "Nm s/rad", 2.0, 0.1, verdict_of(2.0, 0.1)),
        Expected("one", "J", "kg m^2", 0.1, math.nan, verdict_of(0.1, math.nan), "needs acceleration"),
    )
    design = Design(motion().sampled(50.0), rows, ("Check collisions.",))
    text = str(design)
    assert [row.verdict for row in rows] == [Verdict.ESTIMATED, Verdict.NOT_EXCITED] and design.shown == rows[:1]
    assert "1 of 2 parameters will be estimated" in text and "one.J: needs acceleration" in text
    assert "(5 %)" in text and "Check collisions." in text and "not_excited" in text
