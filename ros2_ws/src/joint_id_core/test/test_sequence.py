"""Motions of several joints one after the other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from joint_id_core.design.design import Design, Expected
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.sequence import one_after_other
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import Verdict


def motion(name: str, home: float, duration: float, rate: float = 125.0) -> Trajectory:
    waves = np.full((1, 2), 0.1)
    return FourierMotion((name,), (home,), waves, waves, (0.5, 1.5), duration, 0.5).sampled(rate)


def design(name: str, home: float, duration: float, *notes: str) -> Design:
    row = Expected(name, "J", "kg m^2", 1.0, 0.01, Verdict.ESTIMATED)
    return Design(motion(name, home, duration), (row,), notes)


def test_each_joint_makes_its_motion_while_the_others_stand():
    parts = design("a", 0.3, 2.0, "said of a", "of all"), design("b", -1.0, 3.0, "of all", "said of b")
    found = one_after_other(parts)
    whole = found.trajectory
    assert whole.names == ("a", "b") and math.isclose(whole.duration, 5.0) and math.isclose(whole.rate, 125.0)
    first, then = np.linspace(0.0, 2.0, 777), np.linspace(0.0, 3.0, 777)
    for name, instants, at in (("a", first, first), ("b", then, 2.0 + then)):
        (alone,) = [part.trajectory for part in parts if part.trajectory.names == (name,)]
        own, other = whole.names.index(name), 1 - whole.names.index(name)
        for planned, of_both in zip(alone.at(instants)[:3], whole.at(at)[:3], strict=True):
            np.testing.assert_allclose(of_both[:, own], planned[:, 0], atol=1e-9 * max(1.0, np.abs(planned).max()))
        assert np.ptp(whole.at(at).position[:, other]) == 0.0
    assert whole.moves("a") == pytest.approx((0.0, 2.0)) and whole.moves("b") == pytest.approx((2.0, 5.0))
    assert [row.joint for row in found.expected] == ["a", "b"]
    assert found.notes == ("a: said of a", "b: said of b", "of all")


def test_one_motion_stays_as_it_is():
    alone = design("a", 0.3, 2.0, "said of a")
    found = one_after_other([alone])
    assert np.array_equal(found.trajectory.position, alone.trajectory.position) and found.notes == alone.notes


def test_a_joint_that_stands_throughout_moves_for_the_whole_motion():
    whole, still = motion("a", 0.0, 2.0), np.zeros((251, 1))
    both = Trajectory(
        ("a", "b"),
        whole.time,
        *(np.hstack([part, still]) for part in (whole.position, whole.velocity, whole.acceleration)),
    )
    assert both.moves("b") == (0.0, whole.duration)


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (motion("a", 0.0, 2.0), "name each joint once"),
        (motion("b", 0.0, 2.0, 250.0), "the motion of b: give one joint a motion, all at the same rate"),
    ],
)
def test_motions_that_do_not_fit_together_are_refused(second, said):
    with pytest.raises(JointIdError, match=said):
        one_after_other([design("a", 0.0, 2.0), Design(second, ())])
