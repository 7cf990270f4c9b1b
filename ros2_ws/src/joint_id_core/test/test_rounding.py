"""What a fit finds does not hang on the last bits of its data, nor on the order in which these are given."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.comparison import comparing
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.missing_torques import shapes
from joint_id_core.estimators.innovations.verdicts import verdicts
from joint_id_core.estimators.innovations.whiteness import LAGS, memory
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.free_run import block_length
from joint_id_core.estimators.shared.initial_state import busiest, credible_noise
from joint_id_core.estimators.shared.substeps import steps_of
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.memory import RARE
from joint_id_core.online.score_test import changed_parameters
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict
from joint_id_core.results.report import correlations
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate
from joint_id_core.validation.inverse_dynamics import drive_errors

MODEL = build("rigid_joint")
TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}
LAST_BITS = 1e-14


def nudged(values, seed):
    """Values as another order of the same arithmetic might leave them."""
    return values * (1.0 + LAST_BITS * np.random.default_rng(seed).uniform(-1.0, 1.0, np.shape(values)))


def recorded(period=1 / 300, count=900):
    time = np.arange(count) * period
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    noisy = torque + 0.05 * np.random.default_rng(0).standard_normal(count)
    measured = Sensors(noise={"link_position": 1e-5}).measure(
        simulate(MODEL, time, {"torque": noisy}, TRUTH), 0, keep=("link_position",)
    )
    return measured.with_channels({"torque": torque})


def found(recording):
    estimate = fit(MODEL, recording)
    words = [" ".join(w for w in note.split() if not any(c.isdigit() for c in w)) for note in estimate.notes]
    return estimate, (estimate.status, words, [(p.verdict, p.name) for p in estimate.parameters])


def test_a_fit_of_data_that_differ_in_their_last_bits_is_the_same():
    recording = recorded()
    expected, said = found(recording)
    for seed in range(3):
        other = {n: nudged(v, seed) for n, v in recording.channels.items()}
        estimate, again = found(Recording(recording.time, other))
        assert again == said
        for name in expected.free:
            assert abs(estimate[name].value - expected[name].value) < 1e-3 * expected[name].std_dev, name
            assert estimate[name].std_dev == pytest.approx(expected[name].std_dev, rel=1e-3)


def test_a_fit_does_not_depend_on_the_order_of_channels_and_names():
    recording = recorded()
    turned = Recording(recording.time, dict(reversed(recording.channels.items())))
    expected = fit(MODEL, recording, ParameterSettings(freed=("N", "w_s")))
    other = fit(MODEL, turned, ParameterSettings(freed=("w_s", "N")))
    assert other.values == expected.values and other.notes == expected.notes
    assert np.array_equal(other.covariance, expected.covariance)


def test_the_step_of_an_encoder_shows_through_rounding():
    """Computed as counts times a step in another order, equal readings differ in their last bits."""
    step = 1e-2
    counts = np.round(np.sin(np.arange(2000) * 2e-3) / step)
    span = np.array([2.0])
    expected = credible_noise(counts[None] * step, span)
    assert expected[0, 0] == pytest.approx(step**2 / 120.0)
    for seed in range(5):
        assert credible_noise(nudged(counts[None] * step, seed), span) == pytest.approx(expected, rel=1e-6)


def test_of_a_motion_that_repeats_itself_the_first_stretch_is_taken():
    time = np.arange(3200) * 1e-2
    wave = np.tile(np.sin(np.arange(800) * 2e-2), 4)
    recording = Recording(time, {"link_position": wave, "torque": np.tile(np.cos(np.arange(800) * 1e-2), 4)})
    assert busiest(prepare(MODEL, recording), 800) == 0
    starts = set()
    for seed in range(20):
        other = Recording(time, {n: nudged(v, seed) for n, v in recording.channels.items()})
        starts.add(busiest(prepare(MODEL, other), 800))
    assert starts == {0}


def test_of_partners_that_are_as_strong_the_first_in_the_table_is_named():
    free = ("J", "c", "tau_f", "tau_0")
    coordinates = Coordinates(MODEL, free)
    covariance = np.full((4, 4), 0.99) + 0.01 * np.eye(4)
    for seed in range(10):
        other = nudged(covariance, seed)
        rows = verdicts(MODEL, free, 1e-4 * (other + other.T), coordinates, np.zeros(4))
        named = [rows[name].reason.split("hard to tell from ")[1].split()[0] for name in free]
        assert named == ["c", "J", "J", "J"]


def test_of_parameters_whose_changes_explain_as_much_the_first_is_named():
    """A score and an information that treat three parameters alike."""
    named = set()
    for seed in range(20):
        information = nudged(0.5 * np.ones((3, 3)) + 0.5 * np.eye(3), seed)
        score = nudged(np.array([30.0, 30.0, 30.0]), seed)
        found = changed_parameters(score, 0.5 * (information + information.T), np.ones(4), RARE)
        named.add(found[0])
    assert named == {(0, 1, 2)}


def test_what_is_found_online_does_not_hang_on_the_last_bits():
    """A joint whose inertia changes, watched: the same changes and words, and values that agree."""
    recording = recorded(count=1800)
    heavier = np.where(recording.time < 3.0, 1.0, 0.7)  # less torque moves it as before: inertia and friction fell
    recording = recording.with_channels({"torque": heavier * recording["torque"]})

    def watched(recording):
        one = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=1.0))
        updates = [one.update(recording.slice(k, k + 15)) for k in range(0, len(recording), 15)]
        return [e for e in updates if e is not None]

    expected = watched(recording)
    assert any(e.changes for e in expected)
    for seed in range(3):
        again = watched(Recording(recording.time, {n: nudged(v, seed) for n, v in recording.channels.items()}))
        assert [(e.status, [c.name for c in e.changes]) for e in again] == [
            (e.status, [c.name for c in e.changes]) for e in expected
        ]
        for one, other in zip(expected, again, strict=True):
            for name in one.free:
                assert abs(one[name].value - other[name].value) < 1e-2 * one[name].std_dev, (one.end, name)


def test_a_staircase_of_ten_equal_steps_jumps_at_each():
    model = build("harmonic_drive")
    time = np.arange(110) * 1e-2
    stairs = np.repeat(np.arange(11) * 0.7, 10)
    kernel = SimpleNamespace(cell="implicit")
    states = np.full((110, 4), 1e3)  # nothing turns
    expected = None
    for seed in range(10):
        u = np.column_stack([nudged(stairs, seed), np.zeros(110)])
        data = SimpleNamespace(model=model, u=u, time=time, labels=model.state_names)
        steps = steps_of(data, kernel, np.array(list(model.values().values())), states, 1)
        assert np.flatnonzero(steps > 1).tolist() == list(range(10, 110, 10)), seed
        expected = steps if expected is None else expected
        assert np.array_equal(steps, expected)


def test_the_most_coloured_residuals_are_named_where_no_probability_is_left():
    """Over long records the probability of coloured residuals is zero in floating point, for several labels at once."""
    T = 20000
    rng = np.random.default_rng(0)
    white = rng.standard_normal((T + 20, 2))
    weak, strong = white[20:, 0] + white[19:-1, 0], sum(white[20 - k : T + 20 - k, 1] for k in range(20))
    residuals = np.column_stack([weak / np.std(weak), strong / np.std(strong)])
    data = SimpleNamespace(labels=("motor_velocity", "link_position"), rows=tuple(residuals.T))
    recursion = SimpleNamespace(data=data, scores=lambda last: residuals[:, :1])
    coordinates = SimpleNamespace(slope_at=lambda free: np.ones(1))
    minimum = SimpleNamespace(z=np.zeros(1), hessian=T * np.eye(1), inverse=np.eye(1) / T)
    said = memory(recursion, coordinates, minimum, SimpleNamespace(residuals=residuals, free=np.ones(1))).text
    assert "residuals of link_position" in said and f"{LAGS} samples" in said


@pytest.mark.parametrize("rate, block", [(500, 50), (250, 25), (125, 12), (100, 10), (1000, 100), (3, 1)])
def test_a_free_run_is_as_long_whatever_the_last_digits_of_the_period(rate, block):
    """At 125 Hz a tenth of a second is 12 samples and a half."""
    for off in (-1e-9, 0.0, 1e-9):
        assert block_length(SimpleNamespace(period=(1.0 + off) / rate), 0.1) == block


def test_a_drive_is_judged_on_the_same_samples_on_every_clock():
    """A gap of exactly the longest length that is bridged, and ends exactly at the margin."""
    keep = np.r_[0:150, 154:300]
    count = {}
    for begin in np.linspace(0.0, 1.0, 21):
        time = begin + np.arange(300) * 0.01
        measured = np.sin(3.0 * np.arange(300) * 0.01)
        errors = drive_errors(time[keep], measured[keep], 1.1 * measured[keep])
        count[begin] = np.flatnonzero(np.isfinite(errors)).tolist()
    assert len({tuple(rows) for rows in count.values()}) == 1


def test_a_sharper_coulomb_step_is_not_taken_where_it_changes_nothing(monkeypatch):
    """A joint that never turns: the likelihoods differ in their last bits."""
    recording, deviances = recorded(count=300), iter([-1000.0, -1000.0 - 1e-9])
    estimate = replace(fit(MODEL, recording), deviance=0.0)
    monkeypatch.setattr(comparing, "_fit_once", lambda *_: replace(estimate, deviance=next(deviances)))
    candidate = comparing.Candidate("one", MODEL, ())
    assert comparing._fit(candidate, recording, ParameterSettings(), lambda _: None).deviance == -1000.0


def test_pairs_that_are_as_strongly_correlated_stay_in_the_order_of_the_model():
    rows = tuple(ParameterEstimate(n, "1", 1.0, 1.0, Verdict.ESTIMATED) for n in "abc")
    for seed in range(10):
        r = nudged(np.full((3, 3), 0.99) + 0.01 * np.eye(3), seed)
        estimate = Estimate(
            "m", "innovations", Status.CONVERGED, "", rows, free=tuple("abc"), covariance=0.5 * (r + r.T)
        )
        assert [pair[:2] for pair in correlations(estimate)] == [("b", "a"), ("c", "a"), ("c", "b")]


@pytest.mark.parametrize("angle", [0.1, 0.3, 0.7])
def test_a_joint_that_stands_still_shows_no_load_that_goes_with_its_angle(angle):
    """The angle less its mean is not zero but rounding, and rounding is no shape of a torque."""
    recording = recorded(count=300)
    data = prepare(MODEL, recording)
    for offset in np.linspace(0.0, 1e-3, 50):
        states = np.column_stack([np.full(300, angle + offset), recording["torque"]])
        (load,) = (s for s in shapes(data, states, data.p) if s.name.startswith("a load"))
        assert not any(course.any() for _, course in load.parts)
