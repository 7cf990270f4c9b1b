"""Friction scales of a UR robot: from recordings whose target current holds a model of friction that is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from joint_id_core import formats
from joint_id_core.arm.description import Description
from joint_id_core.arm.friction_scales import friction_scales
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, RATE, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

GAIN = 10.0  # Nm/A
TRUTH = {
    "viscous_scale": np.array([0.6, 0.9, 0.7, 0.8, 1.3, 0.5]),
    "coulomb_scale": np.array([0.8, 0.7, 1.2, 0.6, 0.9, 0.75]),
}
STILL = "tilt"


def record(seconds: float, seed: int = 0) -> dict[str, Recording]:
    """The arm with currents, and those that a controller asks for: friction of the arm over the scales."""
    found = {}
    for j, (name, own) in enumerate(moving_arm.rigid(seconds, seed).items()):
        speed = moving_arm.at(own.time + 0.5 / RATE, seed).dq[:, j]
        viscous, coulomb = VISCOUS[j] * speed, COULOMB[j] * np.sign(speed)
        more = viscous * (1.0 / TRUTH["viscous_scale"][j] - 1.0) + coulomb * (1.0 / TRUTH["coulomb_scale"][j] - 1.0)
        noise = np.random.default_rng([seed, 9, j]).standard_normal(len(speed))
        channels = {
            "link_position": own["link_position"],
            "current": own["torque"] / GAIN,
            "target_current": (own["torque"] + more + 0.05 * noise) / GAIN,
        }
        found[name] = Recording(own.time, channels, source="arm", joint=name)
    return found


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(URDF)
    return path


@pytest.mark.long
def test_the_scales_are_those_of_the_model_in_the_target_current(arm):
    gains = {name: {"current": GAIN} for name in JOINTS}
    found = friction_scales(Description.read(arm), [record(10.0)], gains)
    assert found.joints == JOINTS
    for name, truth in TRUTH.items():
        for scale, ratio in zip(found.scales[name], truth, strict=True):
            assert abs(scale.ratio - ratio) < 4.0 * scale.std_dev and scale.std_dev < 0.1 * ratio, (name, scale)
            assert scale.offered == pytest.approx(min(1.0, scale.ratio - 1.959964 * scale.std_dev))
    halved = friction_scales(Description.read(arm), [record(10.0)], {n: {"current": 0.5 * GAIN} for n in JOINTS})
    for name in TRUTH:  # an error that all torque constants share cancels
        for one, other in zip(found.scales[name], halved.scales[name], strict=True):
            assert other.ratio == pytest.approx(one.ratio, rel=0.02)


def test_the_command_reads_a_bag_and_prints_calls_that_can_be_pasted(arm, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    formats.write_bag("moves", record(8.0))
    words = ("arm", "friction-scales", str(arm), "moves", "--set", "k_t=0.1", "--set", "N=100")
    code, out, err = run(*words)
    assert code == 0 and "Nothing was sent" in out, out + err
    sent = called(out)
    assert set(sent) == set(TRUTH)
    for name, truth in TRUTH.items():
        for scale, ratio in zip(sent[name], truth, strict=True):
            assert 0.8 * min(1.0, ratio) < scale <= min(1.0, 1.05 * ratio), sent
        assert f"{name}={sent[name]}" in out  # the call of URScript
    code, told, err = run(*words, "-o", "scales.txt")
    assert code == 0 and "nothing was sent" in told, err
    assert Path("scales.txt").read_text() == out
    code, _, err = run(*words, "-o", str(arm))
    assert code == 2 and "would overwrite a file that is read" in err


@pytest.mark.long
def test_a_joint_that_does_not_move_keeps_the_scale_of_the_robot(arm, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    moving = record(4.0)
    still = moving[STILL]
    held = {**still.channels, "link_position": np.full(len(still), 0.2)}
    formats.write_bag("moves", {**moving, STILL: Recording(still.time, held, source="arm", joint=STILL)})
    code, out, err = run("arm", "friction-scales", str(arm), "moves", "--set", "k_t=0.1", "--set", "N=100")
    assert code == 0, out + err
    sent, k = called(out), JOINTS.index(STILL)
    assert (sent["viscous_scale"][k], sent["coulomb_scale"][k]) == (0.9, 0.8)
    assert out.count("that of Universal Robots: the measured friction is not_excited") == 2


def called(out: str) -> dict[str, list[float]]:
    """The scales in the call of the service."""
    call = next(line for line in out.splitlines() if line.startswith("ros2 service call "))
    found: dict[str, list[float]] = yaml.safe_load(call.partition('"')[2].rstrip('"'))["parameters"]
    return found


def test_what_is_missing_is_said(arm, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    moving = record(3.0)
    for name in ("current", "target_current"):
        rest = {
            j: Recording(r.time, {n: v for n, v in r.channels.items() if n != name}, joint=j) for j, r in moving.items()
        }
        formats.write_bag(name, rest)
        code, out, err = run("arm", "friction-scales", str(arm), name, "--set", "k_t=0.1", "--set", "N=100")
        assert code == 2 and not out and f"joint turn has no {name}: record actual_current and target_current" in err


def test_a_robot_of_another_number_of_joints_is_refused(arm):
    five = arm.with_name("five.urdf")
    five.write_text(URDF.replace('name="spin" type="continuous"', 'name="spin" type="fixed"'))
    with pytest.raises(JointIdError, match="has 5 joints: a UR robot has 6"):
        friction_scales(Description.read(five), [record(3.0)], {})
