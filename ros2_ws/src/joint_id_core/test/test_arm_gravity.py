"""Gravity that acts elsewhere than it is taken to."""

from __future__ import annotations

import re

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import JOINTS, URDF
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import equations
from joint_id_core.arm.gravity import check_gravity
from joint_id_core.arm.gravity_direction import other_gravity
from joint_id_core.arm.regressor import Regressor

GAINS = {name: {"torque": 1.0} for name in JOINTS}
FLOOR, CEILING, WALL, SLOPE = (0.0, 0.0, -9.81), (0.0, 0.0, 9.81), (9.81, 0.0, 0.0), (0.0, 6.937, -6.937)


def mounted(gravity: tuple[float, float, float]) -> dict[str, Recording]:
    """A recording of the arm whose base is mounted so."""
    record, motion = moving_arm.rigid(8.0, 3), moving_arm.at((np.arange(4000) + 0.5) / moving_arm.RATE, 3)
    more = moving_arm.inverse(motion, gravity=gravity) - moving_arm.inverse(motion)
    return {n: r.with_channels({"torque": r["torque"] + more[:, j]}) for j, (n, r) in enumerate(record.items())}


def check(gravity: tuple[float, float, float], record: dict[str, Recording], urdf: str = URDF) -> None:
    description = Description(urdf, "arm.urdf", gravity)
    regressor = Regressor(description)
    check_gravity(description, regressor, [equations(regressor, record, GAINS, "arm.urdf")])


@pytest.mark.parametrize("taken", first_quick([(WALL,), (CEILING,), (SLOPE,), ((0.0, 0.0, 0.0),)]))
def test_a_base_that_is_mounted_otherwise_is_told_with_its_gravity(taken):
    with pytest.raises(JointIdError, match=r"gravity acts along .* of arm.urdf, not along .* base_gravity\)") as told:
        check(taken, mounted(FLOOR))
    found = [float(v) for v in re.search(r"along (\S+)", str(told.value))[1].split(",")]
    np.testing.assert_allclose(found, FLOOR, atol=0.2)


@pytest.mark.parametrize("gravity", [FLOOR, WALL, SLOPE, (0.0, 0.0, 0.0)])
def test_a_base_that_is_mounted_as_told_passes(gravity):
    check(gravity, mounted(gravity))


def test_links_that_are_only_placeholders_do_not_turn_it():
    placeholders = re.sub(r'mass value="[^"]*"', 'mass value="1"', URDF)
    placeholders = re.sub(r'(<inertial>\s*<origin xyz)="[^"]*"', r'\1="0 0 0"', placeholders)
    check(FLOOR, mounted(FLOOR), placeholders)


def in_amperes(record: dict[str, Recording]) -> dict[str, Recording]:
    """The same with currents, whose constants differ from joint to joint, and nobody knows."""
    constants = np.geomspace(3.0, 90.0, len(record))
    return {
        n: Recording(
            r.time, {"link_position": r["link_position"], "current": r["torque"] / k}, source=r.source, joint=n
        )
        for (n, r), k in zip(record.items(), constants, strict=True)
    }


@pytest.mark.parametrize("taken", [CEILING, WALL, SLOPE])
@pytest.mark.parametrize("mounted_as", [FLOOR, WALL])
def test_for_the_load_of_one_joint_no_torque_constant_is_needed(taken, mounted_as):
    said = other_gravity(Description(URDF, "arm.urdf", taken), [in_amperes(mounted(mounted_as))])
    if taken == mounted_as:
        assert not said
        return
    assert f"not along {','.join(f'{v:.3g}' for v in taken)}" in said
    found = [float(v) for v in re.search(r"--base-gravity (\S+) if", said)[1].split(",")]
    np.testing.assert_allclose(found, mounted_as, atol=0.3)


def test_gravity_that_acts_as_taken_is_not_doubted():
    record = mounted(FLOOR)
    assert not other_gravity(Description(URDF, "arm.urdf", FLOOR), [record, in_amperes(record)])
    light = re.sub(r'mass value="[^"]*"', 'mass value="1"', URDF)
    assert not other_gravity(Description(light, "arm.urdf", FLOOR), [record])


def test_without_drives_gravity_or_motion_nothing_is_said():
    record, wrong = mounted(FLOOR), Description(URDF, "arm.urdf", WALL)
    assert other_gravity(wrong, [record])
    assert not other_gravity(
        wrong, [{n: Recording(r.time, {"link_position": r["link_position"]}) for n, r in record.items()}]
    )
    assert not other_gravity(Description(URDF, "arm.urdf", (0.0, 0.0, 0.0)), [record])
    still = {n: r.with_channels({"link_position": 0.0 * r.time, "torque": 0.0 * r.time}) for n, r in record.items()}
    assert not other_gravity(wrong, [still])


def test_many_recordings_tell_it_as_one_does():
    assert "--base-gravity 0,0,-9.81 if" in other_gravity(Description(URDF, "arm.urdf", WALL), [mounted(FLOOR)] * 13)


def test_a_drive_with_gaps_is_used_as_far_as_it_is_known():
    record, other = mounted(FLOOR), Description(URDF, "arm.urdf", WALL)
    gaps = np.where(np.arange(4000) % 3 > 0, np.nan, 1.0)
    holes = {n: r.with_channels({"torque": gaps * r["torque"]}) for n, r in record.items()}
    assert "--base-gravity 0,0,-9.81 if" in other_gravity(other, [holes])
    nothing = {n: r.with_channels({"torque": np.nan * r["torque"]}) for n, r in record.items()}
    assert not other_gravity(other, [nothing])


def test_one_joint_that_moves_tells_no_single_direction():
    record, first = mounted(FLOOR), JOINTS[1]
    time, other = record[first].time, Description(URDF, "arm.urdf", CEILING)
    alone = {n: r if n == first else r.with_channels({"link_position": 0.0 * time}) for n, r in record.items()}
    moved = np.array([alone[n]["link_position"] for n in JOINTS]).T
    still, true = np.zeros_like(moved), Description(URDF, "arm.urdf", FLOOR)
    torque = true.loads(moved, still, still).torque
    noise = np.random.default_rng(1).normal(0.0, 0.1, torque.shape)
    alone = {n: r.with_channels({"torque": (torque + noise)[:, j]}) for j, (n, r) in enumerate(alone.items())}
    said = other_gravity(other, [alone])
    assert "along another direction" in said and "give its direction with --base-gravity if" in said
