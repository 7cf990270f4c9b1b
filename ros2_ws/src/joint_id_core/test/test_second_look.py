"""Fits of all samples since the start while the memory is young."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online import OnlineIdentifier, OnlineOptions, identifier, second_look
from joint_id_core.online.checks import at_once
from joint_id_core.online.memory import BLOCK_S
from joint_id_core.online.second_look import AFTER, SecondLook, apart

from .online_motion import MODEL, TRUTH, batches, motion

WINDOW_S = 2.0


FIT = SimpleNamespace(end=0.0)


def part(begin: float, end: float) -> Recording:
    time = np.arange(begin, end, 0.01)
    return Recording(time, {"link_position": np.sin(time)})


def test_all_samples_are_fitted_after_two_four_and_eight_windows():
    look, fitted = SecondLook(WINDOW_S, at_once), []
    for k in range(50):
        look.append(part(0.5 * k, 0.5 * (k + 1)))
        look.run(lambda recording: fitted.append(recording) or FIT, np.inf)
    assert [round(r.duration) for r in fitted] == [WINDOW_S * count for count in AFTER]
    assert {r.time[0] for r in fitted} == {0.0}


def test_the_result_comes_with_all_samples_so_far_and_nothing_is_kept_after_the_last_one():
    running: list[Future] = []
    look = SecondLook(WINDOW_S, lambda job: running.append(Future()) or running[-1])
    for k in range(50):
        look.append(part(0.5 * k, 0.5 * (k + 1)))
        found = look.run(lambda recording: None, np.inf)
        if running and k % 10 == 9 and not running[-1].done():
            assert found is None
            running[-1].set_result(FIT)
            found = look.run(lambda recording: None, np.inf)
            assert found.fit is FIT and found.samples.time[-1] == pytest.approx(0.5 * (k + 1), abs=0.02)
    assert len(running) == len(AFTER) and len(look._samples) == 0


def test_a_fit_that_runs_when_the_joint_changes_counts_no_more():
    pending: Future = Future()
    look = SecondLook(WINDOW_S, lambda job: pending)
    look.append(part(0.0, 2.5 * WINDOW_S))
    assert look.run(lambda recording: None, np.inf) is None
    look.end()
    pending.set_result(FIT)
    assert look.run(lambda recording: None, np.inf) is None


def test_a_fit_waits_until_its_samples_were_tested():
    look = SecondLook(WINDOW_S, lambda job: at_once(lambda: SimpleNamespace(end=4.0)))
    look.append(part(0.0, 2.5 * WINDOW_S))
    assert look.run(lambda recording: None, 3.9) is None
    found = look.run(lambda recording: None, 4.0)
    assert found is not None and found.fit.end == 4.0


def test_looks_begin_anew_with_other_samples():
    look, fitted = SecondLook(WINDOW_S, at_once), []
    look.append(part(0.0, 2.5 * WINDOW_S))
    look.begin(part(4.0, 5.0))
    for k in range(10, 30):
        look.append(part(0.5 * k, 0.5 * (k + 1)))
        look.run(lambda recording: fitted.append(recording) or FIT, np.inf)
    assert [(round(r.time[0]), round(r.duration)) for r in fitted] == [(4, 4), (4, 8)]


def test_a_fit_is_apart_from_a_memory_that_is_standard_deviations_off():
    found = fit(MODEL, motion().window(0.0, WINDOW_S))
    coordinates = Coordinates(MODEL, found.free)
    known = second_look.Belief.after(found, coordinates)
    covariance = np.linalg.inv(known.precision)
    near, far = (known.mean + by * np.sqrt(np.diag(covariance)) for by in (0.1, 3.0))
    assert not apart(found, (near, covariance), coordinates)
    assert apart(found, (far, covariance), coordinates)


def test_the_memory_begins_anew_with_all_samples_where_a_fit_ends_elsewhere(monkeypatch):
    real, spans = identifier.Task.fit, []

    def seen(self, recording, previous):
        if previous is None:
            spans.append(recording.duration)
        return real(self, recording, previous)

    monkeypatch.setattr(identifier.Task, "fit", seen)
    monkeypatch.setattr(second_look, "APART", 0.0)  # every fit ends elsewhere
    one = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=WINDOW_S))
    last = [e for samples in batches(motion(10.0)) if (e := one.update(samples)) is not None][-1]
    assert [round(s) for s in spans] == [2, 4, 8]
    assert last.converged and not last.changes
    for name in last.free:
        assert abs(last[name].value - TRUTH[name]) < 4.0 * last[name].std_dev
    follower = one._known.follower
    assert follower.memory.blocks[0].begin.time < 1.0
    # A load soon after that is a change: for a window after such a fit, it was taken for a wrong first one.
    assert follower.age_s > 8.0 - 2.0 * BLOCK_S
