"""Live, motion that no recursion describes is fitted as a whole, as `joint-id fit` does."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import DEFAULT, ParameterSettings, fit
from joint_id_core.filtering.offline import complete
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, stretch
from joint_id_core.online.checks import at_once
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.stretch import EVERY, LEAST, REACH, SHARE, Stretch
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

from .online_motion import MODEL, TRUTH, batches, motion
from .readable import readable

WINDOW_S = 1.0
POOR = "the residuals are not white"


def bending(seed: int, seconds: float = 40.0) -> Recording:
    """A joint as real ones are, at 100 Hz: friction bends with speed, and a torque with a memory acts on it."""
    law, rate = build("rigid_joint", friction="eyring"), 100
    rng, time = np.random.default_rng(seed), np.arange(round(seconds * rate)) / rate
    keeps = math.exp(-1.0 / rate / 0.1)
    pushed = lfilter([0.3 * math.sqrt(1.0 - keeps**2)], [1.0, -keeps], rng.standard_normal(len(time)))
    torque = multisine(time, 25.0, (0.15, 0.4, 0.9), seed=5)
    moved = simulate(law, time, {"torque": torque + pushed}, {**law.values(), "J": 1.7, "tau_0": -0.6})
    angle = moved["link_position"] + 2e-5 * rng.standard_normal(len(time))
    return complete(Recording(time, {"torque": torque, "link_position": angle}, source="bending"))


def live(recording: Recording) -> list[Estimate]:
    """All estimates in motion, after the first window."""
    joint = OnlineIdentifier(MODEL)
    found = [e for samples in batches(recording, 5) if (e := joint.update(samples)) is not None]
    return [e for e in found if e.status is not Status.TOO_SHORT]


@pytest.mark.long
def test_a_joint_whose_friction_bends_is_known_while_it_moves(monkeypatch):
    recording = bending(1)
    estimates = live(recording)
    from_then_on = (2.0 + LEAST + EVERY) * OnlineOptions().window_s  # a window, one that is poor, and two stretches
    later = [e for e in estimates if e.end > from_then_on]
    assert sum(e.converged for e in later) > 0.95 * len(later)
    last = estimates[-1]
    assert "fit of the newest 16 s" in last.message
    whole = fit(MODEL, recording.slice(round(20.0 / recording.period), len(recording)))  # nearest line at its speeds
    for estimate in estimates:
        for row in (estimate[n] for n in ("J", "c", "tau_f")):
            if estimate.converged and row.verdict is Verdict.ESTIMATED:
                off = abs(row.value - whole[row.name].value) / math.hypot(row.std_dev, whole[row.name].std_dev)
                assert off < 4.0, (estimate.end, row)
    monkeypatch.setattr(stretch, "suits", lambda model: False)
    alone = live(recording)
    assert sum(e.converged for e in alone) < 0.3 * len(alone)


@pytest.fixture(scope="module")
def good() -> Estimate:
    return fit(MODEL, motion(3.0))


class Followed:
    """A stretch that follows a motion, and what the recursion says; a fit takes `fit_s`, a look nothing."""

    def __init__(self, monkeypatch, found: Callable[[int], Estimate], fit_s: float = 0.0) -> None:
        self.fitted: list[Recording] = []
        self.estimators: list[str] = []
        self._spent_s = 0.0

        def fitted(_model, recording, _settings, estimator) -> Estimate:
            self.fitted.append(recording)
            self.estimators.append(estimator.name)
            self._spent_s += fit_s if estimator is DEFAULT else 0.0
            return found(len(self.fitted))

        monkeypatch.setattr(stretch, "fit", fitted)
        monkeypatch.setattr(stretch.time, "thread_time", lambda: self._spent_s)
        self.stretch = Stretch(MODEL, ParameterSettings(), WINDOW_S, at_once)
        self._samples = batches(motion(40.0))
        self.time = 0.0

    def move(self, seconds: float, estimate: Estimate, of_late_sensor: bool = False) -> Estimate:
        """Move on; what holds at the end."""
        until, said = self.time + seconds, estimate
        while self.time < until - 1e-9:
            samples = next(self._samples)
            self.time = float(samples.time[-1]) + motion(40.0).period
            self.stretch.append(samples)
            said = self.stretch.on(estimate.updated(end=float(samples.time[-1])), of_late_sensor)
        return said


def lacking(estimate: Estimate, value: float = 2.0) -> Estimate:
    """A fit of a stretch whose residuals show that the model lacks something."""
    assert estimate.checks is not None
    rows = tuple(replace(p, value=value) if p.name == "J" else p for p in estimate.parameters)
    return replace(estimate, checks=replace(estimate.checks, texts=(POOR,)), parameters=rows)


def test_nothing_is_fitted_while_the_recursion_describes_the_motion_or_fails_for_less_than_a_window(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good))
    for _ in range(4):
        assert followed.move(4.0, good).converged
        assert followed.move(0.9 * WINDOW_S, good.updated(status=Status.POOR_FIT)).status is Status.POOR_FIT
    assert not followed.fitted


def test_a_recursion_that_never_described_the_motion_leaves_all_of_it_to_the_fit(monkeypatch, good):
    followed = Followed(monkeypatch, lambda count: lacking(good, 2.0 + count))
    poor = good.updated(status=Status.POOR_FIT)
    assert followed.move(LEAST * WINDOW_S - 0.2, poor).status is Status.POOR_FIT
    found = followed.move(0.4 + EVERY * WINDOW_S, poor)
    assert found.converged and found["J"].value == 4.0
    assert found.message.startswith("Converged. No recursion describes this motion: this is a fit of the newest 3 s")
    assert found.end == pytest.approx(followed.time - motion(40.0).period)
    assert followed.fitted[0].time[0] == 0.0
    followed.move(2.0 * REACH * WINDOW_S, poor)
    starts = np.array([r.time[0] for r in followed.fitted])
    assert np.allclose(np.diff([r.time[-1] for r in followed.fitted]), EVERY * WINDOW_S, atol=0.2)
    assert np.allclose([r.duration for r in followed.fitted[-3:]], REACH * WINDOW_S, atol=0.2)
    assert (np.diff(starts) >= 0.0).all()


def test_a_stretch_that_converges_is_shown_once_the_next_one_does_too(monkeypatch, good):
    statuses = [Status.CONVERGED, Status.CONVERGED, Status.POOR_FIT, Status.CONVERGED, Status.DISAGREE]
    followed = Followed(monkeypatch, lambda count: lacking(good, 1.0 + count).updated(status=statuses[count - 1]))
    poor = good.updated(status=Status.POOR_FIT, message="as it was")
    said = [followed.move(seconds, poor) for seconds in (LEAST * WINDOW_S + 0.3, *[EVERY * WINDOW_S] * 4)]
    assert len(followed.fitted) == len(statuses)
    shown = [Status.POOR_FIT, Status.CONVERGED, Status.POOR_FIT, Status.POOR_FIT, Status.DISAGREE]
    assert [e.status for e in said] == shown
    assert (said[1]["J"].value, said[4]["J"].value) == (3.0, 6.0)


def test_motion_before_a_change_does_not_count(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good))
    followed.move(10.0, good)
    poor = good.updated(status=Status.POOR_FIT)
    followed.move(LEAST * WINDOW_S + 0.5, poor)
    assert followed.fitted[0].time[0] == pytest.approx(10.0, abs=0.11)


def test_a_change_that_the_recursion_tells_forgets_the_motion_before_it(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good))
    followed.move(6.0, good)
    followed.stretch.changed()
    followed.move(LEAST * WINDOW_S + 0.2, good.updated(status=Status.POOR_FIT))
    assert followed.fitted[0].time[0] == pytest.approx(6.0, abs=0.11)


def test_a_fit_from_before_a_change_is_not_shown_after_it(monkeypatch, good):
    statuses = [Status.CONVERGED, Status.POOR_FIT, Status.CONVERGED, Status.CONVERGED]
    followed = Followed(
        monkeypatch, lambda count: lacking(good, 1.0 + count).updated(status=statuses[count - 1]), fit_s=10.0
    )
    poor = good.updated(status=Status.POOR_FIT, message="as it was")
    followed.move((LEAST + EVERY) * WINDOW_S + 0.3, poor)
    followed.stretch.changed()
    said = [followed.move(seconds, poor) for seconds in (LEAST * WINDOW_S + 0.2, EVERY * WINDOW_S)]
    assert followed.estimators == ["innovations", "regression", "innovations", "regression"]
    assert said[0].message == "as it was" and said[1]["J"].value == 4.0


def test_a_change_that_a_poor_recursion_tells_does_not_forget_motion_that_a_fit_describes(monkeypatch, good):
    """Each of its changes, none of them true, made the fits of a UR10e begin anew."""
    followed, poor = Followed(monkeypatch, lambda _: lacking(good)), good.updated(status=Status.POOR_FIT)
    followed.move(LEAST * WINDOW_S + 0.3, poor)
    followed.stretch.changed()
    assert followed.move(EVERY * WINDOW_S, poor).converged
    assert followed.fitted[1].time[0] == followed.fitted[0].time[0]


def test_a_stretch_that_the_model_describes_gives_back_to_the_recursion(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: good)
    poor = good.updated(status=Status.POOR_FIT)
    assert followed.move(5.0, poor).status is Status.POOR_FIT
    assert len(followed.fitted) == 1
    assert followed.move(1.0, good).message == good.message


def test_after_a_stretch_that_it_does_not_describe_it_stays(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good, 5.0))
    followed.move(5.0, good.updated(status=Status.POOR_FIT))
    assert followed.move(5.0, good)["J"].value == 5.0


def test_a_poor_fit_of_the_stretch_says_no_more_than_the_recursion(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good).updated(status=Status.POOR_FIT))
    poor = good.updated(status=Status.POOR_FIT, message="as it was")
    assert followed.move(6.0, poor).message == "as it was"
    assert followed.fitted


def test_at_rest_its_values_stay(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good, 5.0))
    rest = good.updated(status=Status.NO_MOTION, message="It rests.", notes=("It rests.",), end=50.0)
    assert followed.stretch.at_rest(rest) is rest
    followed.move(6.0, good.updated(status=Status.POOR_FIT))
    found = followed.stretch.at_rest(rest)
    assert (found.status, found.message, found.end) == (Status.NO_MOTION, "It rests.", 50.0)
    assert found["J"].value == 5.0


def test_a_sensor_that_is_late_is_told_and_no_fit_that_takes_up_its_delay(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good, 5.0))
    late = good.updated(status=Status.POOR_FIT, message="The sensor is late.")
    assert followed.move(8.0, late)["J"].value == 5.0
    assert followed.move(2.0, late, of_late_sensor=True).message == "The sensor is late."
    rest = good.updated(status=Status.NO_MOTION)
    assert followed.stretch.at_rest(rest) is rest
    assert followed.move(0.5, late).message == "The sensor is late."


def test_a_fit_that_takes_long_is_seldom_made_and_regressions_look_at_the_motion_meanwhile(monkeypatch, good):
    followed = Followed(monkeypatch, lambda _: lacking(good), 11.5 * EVERY * WINDOW_S * SHARE)
    followed.move(39.0, good.updated(status=Status.POOR_FIT))
    ends = np.array([r.time[-1] for r in followed.fitted])
    assert np.allclose(np.diff(ends), EVERY * WINDOW_S, atol=0.2)
    whole = ends[[name == "innovations" for name in followed.estimators]]
    assert len(whole) == 2 and np.allclose(np.diff(whole), 12.0 * EVERY * WINDOW_S, atol=0.2)


@pytest.mark.parametrize("look", [Status.POOR_FIT, Status.CONVERGED])
def test_a_stretch_is_not_shown_any_more_once_newer_motion_contradicts_it(monkeypatch, good, look):
    """Friction of the pan of a UR10e, found in slow motion, was called converged for 36 s."""

    def found(count: int) -> Estimate:
        of = lacking(good, 2.0 if count < 3 else 3.0).updated(end=float(followed.fitted[-1].time[-1]))
        return of.updated(status=look) if count == 3 else of

    followed = Followed(monkeypatch, found, fit_s=10.0)
    poor = good.updated(status=Status.POOR_FIT, message="as it was")
    first = followed.move((LEAST + EVERY) * WINDOW_S + 0.3, poor)
    assert first.converged and first["J"].value == 2.0
    then = followed.move(EVERY * WINDOW_S, poor)
    assert followed.estimators == ["innovations", "regression", "regression"]
    if look is Status.POOR_FIT:
        assert then.message == "as it was"
    else:
        assert then.status is Status.DISAGREE and "indows disagree: J is 2.0" in then.message


def test_a_rigid_joint_as_modelled_is_left_to_the_recursion(monkeypatch):
    monkeypatch.setattr(stretch, "fit", lambda *_: pytest.fail("a stretch was fitted"))
    joint = OnlineIdentifier(MODEL)
    last = [e for samples in batches(motion(12.0)) if (e := joint.update(samples)) is not None][-1]
    assert last.converged and last["J"].value == pytest.approx(TRUTH["J"], rel=0.01)


def test_stretches_that_disagree_are_told_and_the_interval_contains_both(monkeypatch, good):
    """As where friction bends, and a robot moves slowly first."""

    def found(count: int) -> Estimate:
        return lacking(good, 2.0 if count < 3 else 3.0).updated(end=float(followed.fitted[-1].time[-1]))

    followed = Followed(monkeypatch, found)
    poor = good.updated(status=Status.POOR_FIT)
    assert followed.move((LEAST + EVERY) * WINDOW_S + 0.5, poor).converged
    said = followed.move(REACH * WINDOW_S, poor)
    assert said.status is Status.DISAGREE and "indows disagree: J is 2.0" in said.message, said.message
    readable(said.message)
    assert said["J"].value == pytest.approx(2.5, rel=1e-3)
    assert said["J"].std_dev > 0.25
