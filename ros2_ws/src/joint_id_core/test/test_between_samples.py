"""A drive that changes between two samples, and one that is held."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.between_samples import fitted_between
from joint_id_core.estimators.cross_check import cross_checked
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.regression.share import Share
from joint_id_core.estimators.shared.mean_drive import MOST, SELDOM, mean_square_share
from joint_id_core.models import Model, build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.checks import at_once
from joint_id_core.online.second_opinion import SecondOpinion
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import Multisine, position_reference
from joint_id_core.simulation.position_control import ControlledJoint, PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick
from .test_cli_one_command import with_two_encoders

MODEL = build("rigid_joint")
TRUTH = {"J": 2.0, "c": 3.0, "tau_f": 4.0}
FINE_HZ, KEPT = 4000, 16  # simulated, and every 16th sample is kept: 250 Hz
SAYS = "changes between two samples"
CONTROL_HZ = 500
GEAR = {"k_t": 0.1, "N": 101.0}
RIGID, LOAD = build("rigid_joint", actuation="current"), {"J": 1.39, "c": 2.84, "tau_f": 4.61}
FLEXIBLE = build("harmonic_drive", actuation="current")
SENSORS = Sensors(noise={"link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3})


def torque(time: np.ndarray, seed: int) -> np.ndarray:
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 6)
    waves = zip((0.3, 0.7, 1.3, 2.9, 5.0, 7.0), phases, strict=True)
    return sum(20.0 / (1.0 + 0.3 * k) * np.sin(2.0 * np.pi * f * time + a) for k, (f, a) in enumerate(waves))


def motion(seed: int, held: bool, label: str = "link_position") -> Recording:
    """What a recording of 250 Hz shows of a torque that is held for its period, or that changes all the time."""
    step = np.arange(20 * FINE_HZ)
    time = step / FINE_HZ
    acting = torque((step // KEPT * KEPT if held else step + 0.5) / FINE_HZ, seed)
    moved = simulate(MODEL, time, {"torque": acting}, TRUTH)[label][::KEPT]
    noise = (1e-5 if label == "link_position" else 1e-4) * np.random.default_rng(seed).standard_normal(len(moved))
    channels = {"torque": torque(time[::KEPT], seed), label: moved + noise}
    return Recording(time[::KEPT], channels, source="motion")


def errors(estimate: Estimate, truth: Mapping[str, float] = TRUTH) -> dict[str, float]:
    """Errors over standard deviations."""
    return {n: abs(estimate[n].value - true) / estimate[n].std_dev for n, true in truth.items() if n in estimate.free}


@pytest.mark.long
@pytest.mark.parametrize("label", ["link_position", "link_velocity"])
@pytest.mark.parametrize("seed", range(3))
def test_a_torque_that_changes_between_samples_is_taken_as_it_is(seed, label):
    recording = motion(seed, held=False, label=label)
    as_held, found = fit_innovations(MODEL, recording), fit(MODEL, recording)
    assert found.converged and any(SAYS in note for note in found.notes)
    assert max(errors(found).values()) < 4.0
    for name in ("J", "c"):
        off, off_held = (abs(one[name].value - TRUTH[name]) for one in (found, as_held))
        assert off < 0.2 * off_held, "what is at stake"


@pytest.mark.parametrize("label", first_quick(["link_position", "link_velocity"]))
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_a_torque_that_is_held_stays_held(seed, label):
    recording = motion(seed, held=True, label=label)
    found = fit(MODEL, recording)
    assert max(errors(found).values()) < 4.0 and found.converged
    assert not any(SAYS in note for note in found.notes)


@cache
def controlled(model: Model) -> Recording:
    """All samples of a controller, with noise of its sensors in its command, of a joint that follows a multisine."""
    joint = ControlledJoint(
        model, PositionController(), position_reference(), GEAR | (LOAD if model is RIGID else {}), torque_noise=0.003,
        seed=1, sensors=SENSORS,
    )  # fmt: skip
    rows = []
    for _ in range(20 * CONTROL_HZ):
        shown = joint.shown
        rows.append({**shown, **joint.tick(1.0 / CONTROL_HZ)})
    names = ("link_position", "current") if model is RIGID else ("link_position", "motor_velocity", "current")
    return Recording(np.arange(len(rows)) / CONTROL_HZ, {n: np.array([row[n] for row in rows]) for n in names})


def every(nth: int, model: Model = RIGID) -> Recording:
    """Every n-th sample of a controller."""
    whole = controlled(model)
    return Recording(whole.time[::nth], {n: values[::nth] for n, values in whole.channels.items()}, source="every")


@pytest.mark.parametrize("nth", first_quick([4, 2]))
@pytest.mark.parametrize("estimator", first_quick([Innovations(), Regression()]), ids=lambda e: e.name)
def test_some_of_the_samples_of_a_controller_give_the_same_friction(estimator, nth):
    """Viscous friction was up to 38 % too large, 7 standard deviations off, and called converged by both estimators."""
    found = fit(RIGID, every(nth), ParameterSettings(GEAR), estimator)
    assert found.converged and any(SAYS in note for note in found.notes)
    assert found["c"].value == pytest.approx(LOAD["c"], rel=0.03)
    assert max(errors(found, LOAD).values()) < 4.0


def test_what_a_drive_does_within_a_sample_is_not_asked_of_a_model_that_is_wrong_otherwise():
    """Its noise is far above the changes of a sample; four more fits of it took 20 s where a good one takes 0.2 s."""
    recording = every(4)
    held, asked = fit_innovations(RIGID, recording, ParameterSettings(GEAR)), list[Recording]()

    def noted(recording: Recording, previous: Estimate) -> Estimate:
        asked.append(recording)
        return previous

    change = float(np.std(np.diff(recording["current"])))
    for noise, made in ((change, True), (10.0 * change, False)):
        fitted_between(held.updated(noise={**held.noise, "input current": noise}), RIGID, recording, noted)
        assert bool(asked) is made
        asked.clear()


@pytest.mark.parametrize("stiff", [True, False])
def test_a_flexible_joint_is_not_fitted_again_where_a_regression_tells_that_its_drive_is_not_why_it_is_poor(stiff):
    """As that of a rigid joint it describes a stiff one; five more fits took 20 s where a good one takes 0.5 s."""
    model = build("harmonic_drive")
    recording = with_two_encoders(6.0) if stiff else simulate_motion(model, 3.0)
    found = fit_innovations(model, recording)
    if not stiff:  # its drive is late
        recording = recording.with_channels({"torque": np.roll(recording["torque"], 1)})
    change, asked = float(np.std(np.diff(recording["torque"]))), list[Recording]()

    def noted(recording: Recording, previous: Estimate) -> Estimate:
        asked.append(recording)
        return previous

    poor = found.updated(status=Status.POOR_FIT, noise={**found.noise, "input torque": change})
    fitted_between(poor, model, recording, noted)
    assert bool(asked) is not stiff


@pytest.mark.parametrize("estimator", [Innovations(), Regression()], ids=lambda e: e.name)
def test_all_samples_of_a_controller_are_held(estimator):
    found = fit(RIGID, every(1), ParameterSettings(GEAR), estimator)
    assert found.converged and not any(SAYS in note for note in found.notes)


HEAVY = {"J": 6.0, "c": 68.0, "tau_f": 91.0}
TONES_HZ = np.array((0.07, 0.13, 0.21, 0.37))


@cache
def slow_motion(nth: int, speed: float, seed: int) -> Recording:
    """Every n-th sample of half a minute of slow motion, seen by a coarse encoder and a noisy torque sensor."""
    time = np.arange(30 * CONTROL_HZ) / CONTROL_HZ
    followed = Multisine((0.25, 0.2, 0.2, 0.1), tuple(speed * TONES_HZ), (0.0, 1.0, 4.0, 2.0))
    moved = simulate_closed_loop(MODEL, controller_of(MODEL, HEAVY), followed, time, HEAVY, None, 0.0, seed)
    count = 2.0 * np.pi / 2**14
    noisy = moved["torque"] + 2.0 * np.random.default_rng(seed).standard_normal(len(time))
    seen = {"link_position": count * np.round(moved["link_position"] / count), "torque": noisy}
    return Recording(time[::nth], {n: values[::nth] for n, values in seen.items()}, source="slow")


@pytest.mark.long
def test_where_the_motion_hardly_tells_whether_the_drive_was_held_the_interval_contains_both():
    """`J` was `converged` and 10 standard deviations off, as a late drive takes c times its delay off it."""
    found = fit(MODEL, slow_motion(nth=3, speed=2.5, seed=1))
    assert found.converged and max(errors(found, HEAVY).values()) < 2.5
    assert any("hardly tells whether torque was held" in note for note in found.notes)


@pytest.mark.long
def test_all_samples_of_slow_motion_tell_that_the_drive_was_held():
    found = fit(MODEL, slow_motion(nth=1, speed=2.5, seed=1))
    assert found.converged and max(errors(found, HEAVY).values()) < 4.0
    assert not any("held" in note or SAYS in note for note in found.notes)


@pytest.mark.long
@pytest.mark.parametrize("nth", first_quick([3, 5]))
def test_the_share_of_the_next_sample_is_that_of_the_samples_that_were_left_out(nth):
    """It came out too small, as the parameters had made up for a part: `J` was 5 standard deviations off."""
    found = fit(MODEL, slow_motion(nth, speed=4.0, seed=0))
    assert found.converged and max(errors(found, HEAVY).values()) < 4.0
    note = next(note for note in found.notes if SAYS in note)
    share = float(note.split("a share of ")[1].split()[0])
    assert share == pytest.approx((nth - 1) / (2 * nth), abs=0.06)


@pytest.mark.parametrize(
    ("beside", "information", "expected"),
    [
        (0.0, 1e-9, SELDOM * MOST**2 / 3.0),  # nothing is known: one of those that are seldom, with any share
        (0.24, 1e6, 0.24**2),  # surely late
        (0.0, 1e6, 0.0),  # surely held
        (-0.1, 1e4, 0.0),  # early: held
        (0.3, 0.0, SELDOM * MOST**2 / 3.0),
    ],
)
def test_the_mean_square_of_a_delay_is_that_of_what_is_known(beside, information, expected):
    assert mean_square_share(beside, information) == pytest.approx(expected, rel=0.01, abs=1e-6)


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e300))
def test_the_mean_square_of_a_delay_is_between_none_and_a_drive_that_changes_all_the_time(beside, information):
    assert 0.0 <= mean_square_share(beside, information) <= MOST**2


def test_an_estimate_that_takes_the_drive_for_held_is_not_confirmed():
    """As online, where the recursion holds it: the second opinion knows better."""
    settings = ParameterSettings(GEAR)
    as_held = fit_innovations(RIGID, every(2), settings)
    assert as_held.converged and errors(as_held, LOAD)["c"] > 4.0
    found = cross_checked(as_held, RIGID, every(2), settings)
    assert found.status is Status.DISAGREE and any(SAYS in note for note in found.notes)
    assert max(errors(found, LOAD).values()) < 2.0


@pytest.mark.long
@pytest.mark.parametrize("nth", [2, 4])
def test_behind_a_flexible_gear_such_a_recording_is_a_poor_one(nth):
    """Values were up to 25 standard deviations off: when the drive acted within a step is not known."""
    found = fit(FLEXIBLE, every(nth, FLEXIBLE), ParameterSettings(GEAR))
    assert found.status is Status.POOR_FIT and SAYS in found.message and "all samples" in found.message
    assert fit(FLEXIBLE, every(1, FLEXIBLE), ParameterSettings(GEAR)).converged


def followed(recording: Recording, model: Model) -> list[Estimate]:
    """The estimates of the online identifier, one a second."""
    identifier = OnlineIdentifier(model, ParameterSettings(GEAR), OnlineOptions(hop_s=1.0))
    size = round(0.2 / recording.period)
    parts = [recording.slice(i, i + size) for i in range(0, len(recording), size)]
    return [estimate for estimate in map(identifier.update, parts) if estimate is not None]


@pytest.mark.long
def test_online_some_of_the_samples_of_a_controller_are_not_enough():
    """It was converged throughout, and 30 standard deviations off with a flexible gear."""
    assert all(estimate.converged for estimate in followed(every(1, FLEXIBLE), FLEXIBLE))
    poor = followed(every(2, FLEXIBLE), FLEXIBLE)
    assert len(poor) > 10 and all(estimate.status is Status.POOR_FIT for estimate in poor)
    assert any(SAYS in estimate.message for estimate in poor)
    for estimate in followed(every(2), RIGID):  # the second opinion knows what the recursion does not
        assert max(errors(estimate, LOAD).values()) < 4.0


@pytest.mark.parametrize("nth", [1, 2, 4])
def test_online_the_likelihood_tells_it_of_a_short_motion_too(nth):
    """A second of motion, in which the regression is not sure."""
    recording, settings = every(nth).slice(0, CONTROL_HZ // nth), ParameterSettings(GEAR)
    opinion = SecondOpinion(RIGID, settings, window_s=1.0, background=at_once)
    opinion.append(recording)
    estimate = fit_innovations(RIGID, recording, settings)
    found = opinion.on(estimate, tested_from=float(recording.time[-1]))
    assert any(SAYS in note for note in found.notes) == (nth > 1)
    assert max(errors(found, LOAD).values()) < 3.0


@pytest.mark.long
def test_no_mean_is_taken_over_a_gap_or_a_missing_value():
    """The samples beside them count as held."""
    recording = motion(0, held=False)
    there = np.ones(len(recording), dtype=bool)
    there[1000:1100] = there[3000:3002] = False
    drive = recording["torque"].copy()
    drive[2000] = np.nan
    channels = {"torque": drive[there], "link_position": recording["link_position"][there]}
    found = fit(MODEL, Recording(recording.time[there], channels, source="motion"))
    assert max(errors(found).values()) < 4.0 and any(SAYS in note for note in found.notes)


def test_a_recording_without_a_drive_keeps_its_message():
    without = Recording(np.arange(100) / 250.0, {"link_position": np.sin(np.arange(100) / 10.0)}, source="motion")
    assert "torque" in fit(MODEL, without).message


@pytest.mark.parametrize(("value", "sigma", "late"), [(0.0015, 1e-4, False), (0.25, 0.02, True), (0.25, 0.1, False)])
def test_a_drive_that_is_late_by_nothing_that_a_controller_does_is_held(value, sigma, late):
    """A share of 0.0015, sure by its standard deviation, made intervals twenty times as wide live; on one processor."""
    share = Share(value, sigma, np.array([1.0]))
    assert share.sure is late
    if not late:
        assert 0.0 < share.doubt(taken=False)[0] < 2.0 * value, "intervals still contain it"
