"""The situations of the online identifier: every way from one to the next."""

from __future__ import annotations

import pytest

from joint_id_core.online.follower import Found
from joint_id_core.online.situation import Situation

FOLLOWS = (Situation.RESUMED, Situation.FOLLOWING, Situation.ON_TRIAL)
WAITS = (Situation.STARTING, Situation.RESTARTING, Situation.SUSPENDED)


def test_samples_pass_through_the_filter_where_there_is_a_memory_that_describes_them():
    assert {s for s in Situation if s.follows} == set(FOLLOWS)
    assert set(Situation) == {*FOLLOWS, *WAITS}


@pytest.mark.parametrize("situation", FOLLOWS)
@pytest.mark.parametrize("agreed", [False, True])
def test_what_the_samples_say_decides(situation, agreed):
    assert situation.after_samples(Found.WRONG_START, agreed) is Situation.RESTARTING
    assert situation.after_samples(Found.UNEXPLAINED, agreed) is Situation.SUSPENDED
    assert situation.after_samples(Found.AGREES, False) is situation


@pytest.mark.parametrize("found", [Found.AGREES, Found.CHANGING])
def test_only_a_trial_ends_with_enough_motion(found):
    assert Situation.ON_TRIAL.after_samples(found, True) is Situation.FOLLOWING
    assert Situation.RESUMED.after_samples(found, True) is Situation.RESUMED  # its age counts what was seen before
    assert Situation.FOLLOWING.after_samples(found, True) is Situation.FOLLOWING


@pytest.mark.parametrize("situation", WAITS)
@pytest.mark.parametrize("found", list(Found))
def test_what_an_older_memory_says_changes_nothing(situation, found):
    assert situation.after_samples(found, True) is situation


def test_every_new_fit_but_the_first_is_on_trial():
    assert Situation.RESTARTING.after_fit() is Situation.SUSPENDED.after_fit() is Situation.ON_TRIAL
    assert Situation.STARTING.after_fit() is Situation.FOLLOWING


@pytest.mark.parametrize("situation", [Situation.RESUMED, Situation.FOLLOWING])
def test_a_window_that_disagrees_suspends(situation):
    assert situation.after_window(True) is Situation.FOLLOWING
    assert situation.after_window(False) is Situation.SUSPENDED
