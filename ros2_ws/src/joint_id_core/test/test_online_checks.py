"""Checks of whole windows beside the recursion: which of them answers a doubt about the noise levels."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.online import OnlineIdentifier
from joint_id_core.online.checks import Checked, WindowChecks, at_once
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, Status

from .online_motion import MODEL, NOISE, batches, motion

NOISIER_AT = 8.2  # s, just after the window of the check that begins at 8 s
ENDS_AT = 9.3  # s, at which that check ends


@pytest.mark.parametrize("status", [Status.CONVERGED, Status.POOR_FIT])
def test_a_window_from_before_a_doubt_does_not_answer_it(status):
    """A sensor becomes noisier while a check runs: what it says of older samples is no verdict on the newest ones."""
    late, older, began = Future(), [], []

    def background(job):
        done = Future()
        done.set_result(job())
        if not isinstance(done.result(), Estimate) or done.result().start < 1.0:
            return done  # a second opinion; a second look, at all samples since the start
        began.append(done.result().end)
        if not 7.0 < began[-1] < NOISIER_AT:
            return done
        older.append(replace(done.result(), status=status))
        return late

    record = motion()
    more = 4.0 * NOISE * np.random.default_rng(5).standard_normal(len(record)) * (record.time > NOISIER_AT)
    noisier = record.with_channels({"link_position": record["link_position"] + more})
    identifier = OnlineIdentifier(MODEL, background=background)
    before, found = [], []
    for samples in batches(noisier):
        if samples.time[0] > ENDS_AT and not late.done():
            late.set_result(older[0])
        estimate = identifier.update(samples)
        if estimate is not None:
            (found if late.done() else before).append(estimate)
    assert len(older) == 1
    assert all(e.converged for e in (*before, *found))
    assert ENDS_AT < began[2] < ENDS_AT + 1.0  # the next one, as soon as the older one has ended
    assert found[-1].noise["link_position"] == pytest.approx(np.hypot(1.0, 4.0) * NOISE, rel=0.1)


def test_only_the_window_that_was_taken_after_a_doubt_answers_it():
    jobs = []

    def background(job):
        jobs.append(Future())
        return jobs[-1]

    def hop():
        window.append(motion().slice(len(window), len(window) + 50))
        return checks.run(window, lambda _: None, tested_from=window.end)

    checks, window = WindowChecks(0.2, background), SlidingWindow(100.0)
    checks.begin(0.0)
    assert hop() is None and hop() is None and len(jobs) == 1
    checks.ask()
    checks.ask()
    assert hop() is None and len(jobs) == 1  # one at a time
    jobs[0].set_result("older")
    assert hop() == Checked("older", doubted=False)
    assert hop() is None and len(jobs) == 2
    checks.ask()  # the same doubt
    jobs[1].set_result("newer")
    assert hop() == Checked("newer", doubted=True)
    checks.ask()
    assert hop() is None and len(jobs) == 3
    checks.begin(window.end)  # no doubt outlives a new beginning
    assert hop() is None and hop() is None and len(jobs) == 4
    jobs[3].set_result("first")
    assert hop() == Checked("first", doubted=False)


def test_the_result_of_a_window_waits_until_samples_after_it_were_tested():
    """A change at its end, too short for the test of the newest samples, looks like a wrong model."""
    checks, window = WindowChecks(2.0, at_once), SlidingWindow(2.0)
    window.append(motion().slice(0, 1000))

    def result(tested_from):
        return checks.run(window, lambda recording: recording.time[-1], tested_from)

    checks.begin(0.0)
    assert result(window.end - 0.1) is None
    assert result(window.end) == Checked(window.end, doubted=False)
    checks.begin(0.0)
    assert result(window.end - 0.1) is None
    checks.begin(window.end)  # the test has found a change
    assert result(window.end + 0.1) is None


def test_no_window_with_a_change_in_it_is_checked_even_if_the_noise_is_in_doubt():
    """A window may reach back many seconds, with rests in it; a load in it looked like another joint."""
    checks, window = WindowChecks(2.0, at_once), SlidingWindow(2.0)
    window.append(motion().slice(0, 1000))
    checks.begin(window.end - 1.0, changed_at=window.end - 0.5)
    checks.ask()
    assert not checks.due(window)
    checks.begin(window.end - 1.0, changed_at=window.start)
    checks.ask()
    assert checks.due(window)
