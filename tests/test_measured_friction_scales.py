"""Friction scales of a UR10e: three public logs, each by itself, agree."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from robots.recordings import DATA, UR10E_ALL, UR10E_NM_PER_A

from joint_id_core.arm.description import Description
from joint_id_core.arm.friction_scales import INTERVAL, friction_scales
from joint_id_core.data.recording import Recording

FOLDER = DATA / "ur10e"
FIELDS = {"link_position": 1, "current": 13, "target_current": 19}  # first column of each

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"public UR10e logs not at {FOLDER}")


def record(name: str, joints: tuple[str, ...]) -> dict[str, Recording]:
    """All joints of a log, by name."""
    table = np.genfromtxt(FOLDER / f"{name}.csv", delimiter=",")
    table = table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])]  # some stamps repeat
    return {
        joint: Recording(table[:, 0], {n: table[:, first + k] for n, first in FIELDS.items()}, source=name, joint=joint)
        for k, joint in enumerate(joints)
    }


@pytest.mark.long
def test_scales_of_three_logs_agree() -> None:
    description = Description.read(FOLDER / "ur10e.urdf")
    joints = tuple(description.joints)
    gains = {name: {"current": UR10E_NM_PER_A[k]} for k, name in enumerate(joints, 1)}
    found = [friction_scales(description, [record(name, joints)], gains).scales for name in UR10E_ALL]
    agree, shares = [], []
    for one, other in combinations(found, 2):
        for name in one:
            for a, b in zip(one[name], other[name], strict=True):
                assert not a.reason and not b.reason and 0.7 < a.ratio < 1.6
                agree.append(abs(a.ratio - b.ratio) < INTERVAL * np.hypot(a.std_dev, b.std_dev))
                shares.append(a.std_dev / a.ratio)
    assert len(agree) == 36 and sum(agree) >= 34
    assert np.median(shares) < 0.04
