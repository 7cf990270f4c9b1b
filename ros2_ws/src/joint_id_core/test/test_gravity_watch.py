"""Gravity that acts elsewhere than it is taken to, from samples as they arrive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pytest

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.data.instants import NANO
from joint_id_core.data.recording import Array

from . import moving_arm
from .moving_arm import JOINTS, RATE, URDF

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.gravity_watch import EVERY, LATER_NS, MOTION, GravityWatch

FLOOR, CEILING, WALL = (0.0, 0.0, -9.81), (0.0, 0.0, 9.81), (9.81, 0.0, 0.0)
SEED, SECONDS = 5, 24.0
DERIVED = frozenset(MOTION[1:])


@pytest.fixture(scope="module")
def moved() -> dict[str, Array]:
    """Channels of all joints, shape (T, 6), of an arm on the floor."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    motion = moving_arm.at(time, SEED)
    rng = np.random.default_rng(1)
    friction = moving_arm.VISCOUS * motion.dq + moving_arm.COULOMB * np.sign(motion.dq)
    torque = moving_arm.inverse(motion) + moving_arm.ROTOR * motion.ddq + friction
    shown = dict(zip(MOTION, (motion.q, motion.dq, motion.ddq + rng.normal(0.0, 0.3, motion.q.shape)), strict=True))
    return {**shown, "torque": torque + rng.normal(0.0, 0.1, torque.shape)}


def messages(channels: Mapping[str, Array], begin_s: float = 1.0, joints=JOINTS) -> Iterator[AlignedSamples]:
    """The samples, ten at a time."""
    instants = [round((begin_s + k / RATE) * NANO) for k in range(len(channels[MOTION[0]]))]
    for k in range(0, len(instants), 10):
        rows = slice(k, k + 10)
        yield AlignedSamples(instants[rows], joints, {n: v[rows] for n, v in channels.items()}, DERIVED)


def told(watch: GravityWatch, channels: Mapping[str, Array], **more) -> list[int]:
    """Numbers of the messages after which gravity is doubted."""
    return [k for k, samples in enumerate(messages(channels, **more)) if watch.add(samples)]


@pytest.mark.parametrize("taken", [CEILING, WALL])
def test_a_base_that_is_mounted_otherwise_is_told_with_the_parameter(moved, taken):
    watch = GravityWatch(Description(URDF, "arm.urdf", taken))
    assert told(watch, moved)
    assert "fit gravity along 0,0,-9.81 m/s^2 in the frame of the base of arm.urdf" in watch.doubt
    assert "give base_gravity:=[0.0, 0.0, -9.81] if the base is mounted so" in watch.doubt


@pytest.mark.parametrize("mounted_as", [FLOOR, WALL])
@pytest.mark.parametrize("drive", ["torque", "current"])
def test_gravity_that_acts_as_taken_is_not_doubted(moved, mounted_as, drive):
    motion = moving_arm.at(np.arange(len(moved["torque"])) / RATE, SEED)
    more = moving_arm.inverse(motion, gravity=mounted_as) - moving_arm.inverse(motion)
    constants = np.geomspace(3.0, 90.0, len(JOINTS)) if drive == "current" else 1.0
    shown = {**{n: moved[n] for n in MOTION}, drive: (moved["torque"] + more) / constants}
    assert not told(GravityWatch(Description(URDF, "arm.urdf", mounted_as)), shown)


def test_a_doubt_ends_with_torques_that_fit(moved):
    """As when a tool that the description lacks is put down; here torques of the wrong sign are mended."""
    longer = {name: np.concatenate([values, values]) for name, values in moved.items()}
    watch = GravityWatch(Description(URDF, "arm.urdf", FLOOR))
    assert told(watch, {**moved, "torque": -moved["torque"]})
    told(watch, longer, begin_s=100.0)
    assert not watch.doubt


def test_one_joint_that_moves_tells_no_single_direction(moved):
    q = np.where(np.arange(len(JOINTS)) == 1, moved[MOTION[0]], 0.0)
    still = np.zeros_like(q)
    torque = Description(URDF, "arm.urdf", FLOOR).loads(q, still, still).torque
    torque = torque + np.random.default_rng(3).normal(0.0, 0.1, torque.shape)
    watch = GravityWatch(Description(URDF, "arm.urdf", CEILING))
    assert told(watch, {MOTION[0]: q, MOTION[1]: still, MOTION[2]: still, "torque": torque})
    assert "along another direction" in watch.doubt and "give its direction with base_gravity if" in watch.doubt


def test_a_robot_that_rests_tells_nothing(moved):
    still = {name: np.broadcast_to(values[:1], values.shape) for name, values in moved.items()}
    noise = np.random.default_rng(2).normal(0.0, 1e-4, still[MOTION[0]].shape)
    watch = GravityWatch(Description(URDF, "arm.urdf", CEILING))
    assert not told(watch, {**still, MOTION[0]: still[MOTION[0]] + noise}) and not watch.doubt


@pytest.mark.long
def test_rests_do_not_drive_out_what_moved(moved):
    """The poses of before a rest count on after it."""
    half = round(0.8 * EVERY * LATER_NS / NANO * RATE)  # too few for a check
    parts = [{n: v[:half] for n, v in moved.items()}, {n: v[half : 2 * half] for n, v in moved.items()}]
    rest = {n: np.repeat(v[half - 1 : half], 40 * half, axis=0) for n, v in moved.items()}
    rest[MOTION[1]], rest[MOTION[2]] = np.zeros_like(rest[MOTION[1]]), np.zeros_like(rest[MOTION[2]])
    watch = GravityWatch(Description(URDF, "arm.urdf", CEILING))
    assert not told(watch, parts[0])
    assert not told(watch, rest, begin_s=100.0)
    assert told(watch, parts[1], begin_s=1000.0)


def test_without_gravity_drives_or_all_joints_there_is_nothing_to_tell(moved):
    wrong = Description(URDF, "arm.urdf", CEILING)
    assert not told(GravityWatch(Description(URDF, "arm.urdf", (0.0, 0.0, 0.0))), moved)
    assert not told(GravityWatch(wrong), {n: moved[n] for n in MOTION})
    assert not told(GravityWatch(wrong), {**moved, "torque": np.full_like(moved["torque"], np.nan)})
    assert not told(GravityWatch(wrong), {**moved, MOTION[2]: np.full_like(moved["torque"], np.nan)})
    assert not told(GravityWatch(wrong), {n: v[:, :5] for n, v in moved.items()}, joints=JOINTS[:5])


def test_joints_are_found_by_name_and_time_may_jump_back(moved):
    order = [5, 0, 3, 1, 4, 2]
    shuffled = {n: np.column_stack([v[:, order], v[:, 0]]) for n, v in moved.items()}
    watch = GravityWatch(Description(URDF, "arm.urdf", CEILING))
    names = [*(JOINTS[k] for k in order), "gripper"]
    assert not told(watch, {n: v[:1000] for n, v in shuffled.items()}, begin_s=1e6, joints=names)
    assert told(watch, shuffled, joints=names)


def test_amperes_do_not_mix_with_torques(moved):
    """A driver that begins to give currents makes no jump in the torques."""
    half = len(moved["torque"]) // 2
    first = {n: v[:half] for n, v in moved.items()}
    amperes = np.geomspace(3.0, 90.0, len(JOINTS))
    second = {n: v[half:] for n, v in moved.items() if n != "torque"} | {"current": moved["torque"][half:] / amperes}
    watch = GravityWatch(Description(URDF, "arm.urdf", FLOOR))
    assert not told(watch, first) and not told(watch, second, begin_s=1.0 + SECONDS)
