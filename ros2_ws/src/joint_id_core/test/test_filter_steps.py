"""Integrator steps of the online filter, whose memory averages noise away, and no error of the integrator."""

from joint_id_core.estimators import Innovations
from joint_id_core.online import OnlineIdentifier

from .online_motion import MODEL, batches, motion


def steps(substeps: int) -> tuple[int, int]:
    """Steps a sample of the filter, and of the fit of the window with which it began."""
    identifier = OnlineIdentifier(MODEL, estimator=Innovations(substeps=substeps))
    found = [e for samples in batches(motion(2.5)) if (e := identifier.update(samples)) is not None]
    return identifier._known.follower.tracker.substeps, found[0].substeps


def test_the_filter_takes_two_steps_where_one_is_enough_for_a_window():
    assert steps(0) == (2, 1)


def test_steps_that_were_asked_for_stay():
    assert steps(1) == (1, 1) and steps(3) == (3, 3)
