"""Online, a second estimator checks what the recursion finds."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.opinion import Opinion, Second
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions, second_opinion
from joint_id_core.online.checks import at_once
from joint_id_core.online.second_opinion import AFTER_FAULT, REACH, SecondOpinion
from joint_id_core.results.estimate import Estimate, Status

from .online_motion import MODEL, TRUTH, batches, motion

GOOD = Opinion("", (Second("J", TRUTH["J"], 0.01, 1.0),), 0.999)


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return fit(MODEL, motion(3.0))


def estimates(opinion: Callable[..., Opinion | None] | None, monkeypatch) -> list[Estimate]:
    if opinion is not None:
        monkeypatch.setattr(second_opinion, "second_opinion", opinion)
    joint = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=2.0, hop_s=0.5))
    return [e for samples in batches(motion()) if (e := joint.update(samples)) is not None]


def all_asked(
    monkeypatch, estimate: Estimate, answer: Callable[[int], Opinion]
) -> tuple[list[Recording], Opinion | None]:
    """Return what is asked about in 20 s of motion, with windows of 1 s, and the last opinion.

    `answer` gets how often it was asked.
    """
    asked: list[Recording] = []

    def ask(_estimate, _model, recording, _settings) -> Opinion:
        asked.append(recording)
        return answer(len(asked))

    monkeypatch.setattr(second_opinion, "second_opinion", ask)
    opinion = SecondOpinion(MODEL, ParameterSettings(), 1.0, at_once)
    for samples in batches(motion(20.0)):
        opinion.append(samples)
        opinion.on(estimate, float(samples.time[-1]))
    return asked, opinion.newest


def test_where_both_agree_nothing_changes(monkeypatch):
    assert all(e.converged for e in estimates(None, monkeypatch))


def test_a_disagreement_is_published_with_an_interval_that_contains_both(monkeypatch):
    other = Opinion("", (Second("J", 0.5 * TRUTH["J"], 0.02, 1.0),), 0.99)
    found = estimates(lambda *_, **__: other, monkeypatch)
    assert found[0].converged and found[-1].status is Status.DISAGREE  # an opinion needs more than the first window
    row = found[-1]["J"]
    assert row.value - 1.96 * row.std_dev < 0.5 * TRUTH["J"] < TRUTH["J"] < row.value + 1.96 * row.std_dev
    assert "by regression" in found[-1].message


def test_equations_that_are_not_those_of_the_motion_are_a_poor_fit(monkeypatch):
    found = estimates(lambda *_, **__: Opinion("other joints move", (), 0.6), monkeypatch)
    assert found[-1].status is Status.POOR_FIT and found[-1].message.startswith("Other joints move.")


def test_it_is_asked_after_one_two_and_four_windows_more_and_looks_back_over_eight(monkeypatch, estimate):
    asked, newest = all_asked(monkeypatch, estimate, lambda _: GOOD)
    assert np.round([r.time[-1] for r in asked]).tolist() == [1.0, 3.0, 7.0, 15.0]
    assert asked[-1].duration == pytest.approx(REACH, abs=0.2)
    assert newest is GOOD


def test_after_a_fault_it_is_asked_again_soon_and_about_new_motion_only(monkeypatch, estimate):
    """Samples of another source, or of a failing sensor, may have been the cause, and may have ended."""
    asked, newest = all_asked(
        monkeypatch, estimate, lambda count: GOOD if count > 4 else Opinion("the samples are of another joint", (), 0.1)
    )
    assert np.round(np.diff([r.time[-1] for r in asked[:5]])).tolist() == [AFTER_FAULT] * 4
    assert all(r.duration <= AFTER_FAULT + 0.1 for r in asked[1:5])
    assert newest is GOOD


def test_a_memory_that_is_new_is_asked_for_again_once(monkeypatch, estimate):
    """A fault of a sensor that has ended leaves one in the samples; what the model lacks stays."""
    asked, _ = all_asked(monkeypatch, estimate, lambda count: GOOD if count == 1 else replace(GOOD, coloured=True))
    assert np.round([r.time[-1] for r in asked]).tolist() == [1.0, 3.0, 6.0, 14.0]
    assert asked[2].duration <= AFTER_FAULT + 0.1
    assert asked[3].duration == pytest.approx(REACH, abs=0.2)


def test_an_answer_waits_for_a_test_of_what_follows_and_is_dropped_when_the_joint_has_changed(estimate):
    answers: list[Future[Opinion | None]] = []

    def later(job):
        answers.append(Future())
        return answers[-1]

    opinion = SecondOpinion(MODEL, ParameterSettings(), 1.0, later)
    opinion.append(motion(1.5))
    opinion.on(estimate, 0.0)
    answers[0].set_result(GOOD)
    opinion.on(estimate, 1.0)
    assert opinion.newest is None  # the newest block that agreed began before the end of the motion
    opinion.begin()
    opinion.on(estimate, 5.0)
    assert opinion.newest is None and len(answers) == 1


@pytest.mark.parametrize(("name", "wanted"), [("harmonic_drive", True), ("rigid_joint", False)])
def test_a_model_without_a_second_estimator_asks_for_none(estimate, name, wanted):
    nobody = partial(pytest.fail, "no opinion is wanted")
    opinion = SecondOpinion(build(name), ParameterSettings(), 1.0, nobody, wanted)
    for samples in batches(motion(5.0)):
        opinion.append(samples)
        assert opinion.on(estimate, float(samples.time[-1])) is estimate
