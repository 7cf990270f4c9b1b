"""Trajectories go through JointTrajectory and come back; messages that are none are refused with a reason."""

import numpy as np
import pytest
from trajectory_msgs.msg import JointTrajectory

from joint_id_core.design.files import read_trajectory, write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.errors import JointIdError
from joint_id_ros.trajectories import STOP, from_message, to_message

MOTION = FourierMotion(("a", "b"), [0.3, -1.0], [[0.1], [0.2]], [[0.1], [0.0]], [0.7], 4.0, 1.0).sampled(125.0)


def test_a_trajectory_comes_back_as_it_was():
    again = from_message(to_message(MOTION))
    assert again.names == MOTION.names
    for name in ("time", "position", "velocity", "acceleration"):
        np.testing.assert_allclose(getattr(again, name), getattr(MOTION, name), rtol=1e-15, atol=1e-9)


def test_the_message_is_that_of_the_file(tmp_path):
    write(MOTION, tmp_path / "motion.yaml")
    again = from_message(to_message(read_trajectory(tmp_path / "motion.yaml")))
    np.testing.assert_allclose(again.position, MOTION.position, atol=1e-11)


def test_a_stop_has_neither_joints_nor_points():
    assert JointTrajectory() == STOP and not STOP.points and not STOP.joint_names


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda m: setattr(m.points[3], "velocities", []), "point 3 has 0 velocities for 2 joints"),
        (lambda m: setattr(m.points[9], "positions", [0.0] * 3), "point 9 has 3 positions for 2 joints"),
        (lambda m: m.points.pop(5), "the samples are not evenly spaced"),
        (lambda m: m.points.pop(), "at the end: a motion starts and ends at rest"),
        (lambda m: m.joint_names.__setitem__(1, "a"), "name each joint once"),
        (lambda m: setattr(m.points[7], "positions", [np.nan, 0.0]), "position of a at sample 7 is nan"),
    ],
)
def test_what_is_no_trajectory_is_refused(spoil, says):
    message = to_message(MOTION)
    spoil(message)
    with pytest.raises(JointIdError, match=says):
        from_message(message)
