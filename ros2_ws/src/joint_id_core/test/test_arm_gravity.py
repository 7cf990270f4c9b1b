"""Gravity that acts elsewhere than it is taken to."""

from __future__ import annotations

import re

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import JOINTS, URDF

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import equations
from joint_id_core.arm.gravity import check_gravity
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


@pytest.mark.parametrize("taken", [CEILING, WALL, SLOPE, (0.0, 0.0, 0.0)])
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
