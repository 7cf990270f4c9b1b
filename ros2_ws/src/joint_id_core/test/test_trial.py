"""What fits of windows that the model does not describe may cost."""

import itertools
from types import SimpleNamespace

import numpy as np

from joint_id_core.online import OnlineIdentifier, OnlineOptions, trial
from joint_id_core.online.follower import Found
from joint_id_core.online.task import Task
from joint_id_core.online.trial import LONG_S, PATIENCE, SHARE, Trial
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.status import Status

from .online_motion import MODEL, batches, motion

WINDOW_S, TOOK_S = 2.0, 0.6
POOR = SimpleNamespace(status=Status.POOR_FIT)


def test_fits_that_fail_again_and_again_wait_for_what_they_cost():
    now = Trial(WINDOW_S)
    now.failed(POOR, 1.0, TOOK_S)
    assert not now.waits(1.1) and now.shown is POOR
    late = 1.1 + PATIENCE * WINDOW_S
    now.failed(POOR, late, TOOK_S)
    assert now.waits(late + 0.99 * TOOK_S / SHARE) and not now.waits(late + 1.01 * TOOK_S / SHARE)
    assert not now.due(late + 1.0) and now.due(late + 1.01 * TOOK_S / SHARE)


def test_a_long_fit_that_fails_is_followed_by_as_much_motion_without_one():
    now = Trial(WINDOW_S)
    now.failed(POOR, 1.0, 0.9 * LONG_S)
    assert not now.waits(1.1)
    now.failed(POOR, 1.1, 7.0)
    assert now.waits(8.0) and not now.waits(8.2)


def test_a_fit_that_describes_the_motion_ends_the_patience_anew():
    now = Trial(WINDOW_S)
    now.failed(POOR, 1.0, TOOK_S)
    now.succeeded()
    now.failed(POOR, 20.0, TOOK_S)
    assert not now.waits(20.1)


def test_a_sensor_is_blamed_as_long_as_its_delay_explains_the_newest_window_of_a_joint_that_is_trusted():
    late = SimpleNamespace(text="The sensor is late.")
    found = iter([late, None, late])
    known = SimpleNamespace(
        last=Estimate("rigid_joint", "innovations", Status.CONVERGED, "", ()),
        follower=SimpleNamespace(found=Found.UNEXPLAINED), late_sensor=lambda _: next(found),
    )  # fmt: skip
    now = Trial(WINDOW_S)
    assert now.late(motion(1.0)) is None and not now.blames_sensor  # nothing is known yet
    now.suspend(known)
    assert now.late(motion(1.0)) is late and now.blames_sensor
    assert now.shown.notes == ("The sensor is late.",)
    assert now.late(motion(1.0)) is None and not now.blames_sensor
    now.late(motion(1.0))
    now.begin_anew(known)
    assert not now.blames_sensor


def test_a_joint_that_its_model_never_describes_still_has_an_estimate_at_every_hop(monkeypatch):
    """Its torque is another one's: a joint at 1 kHz took 1.5 of a core for that."""
    monkeypatch.setattr(trial, "SHARE", 1e-6)
    clock = itertools.count(0.0, 0.25)
    monkeypatch.setattr("time.thread_time", lambda: next(clock))
    ended, fit = [], Task.fit

    def counted(task, recording, previous):
        ended.append(recording.time[-1])
        return fit(task, recording, previous)

    monkeypatch.setattr(Task, "fit", counted)
    rng, record = np.random.default_rng(0), motion(16.0)
    wrong = record.with_channels({"torque": rng.normal(0.0, 3.0, len(record))})
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=WINDOW_S, hop_s=0.5))
    found = [e for e in map(identifier.update, batches(wrong)) if e is not None and e.status is not Status.TOO_SHORT]
    assert len(found) > 25 and {e.status for e in found} == {Status.POOR_FIT}
    assert np.all(np.diff([e.end for e in found]) > 0.0)
    assert max(ended) < WINDOW_S + PATIENCE * WINDOW_S + 1.1  # then they wait
