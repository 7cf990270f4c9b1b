"""The online identifier: what it says while samples arrive, and what it remembers."""

from __future__ import annotations

from concurrent.futures import Future

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations, ParameterSettings, fit
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.shared.stillness import STILL_S
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.published import published, said
from joint_id_core.online.window import SlidingWindow
from joint_id_core.pages.contents import windows
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.plants import MotionOptions, PositionControl
from joint_id_core.simulation.sensors import Sensors, ur_robot_sensors
from joint_id_core.simulation.simulator import simulate

from .online_motion import MODEL, RATE, TRUTH, batches, motion
from .quick import first_quick


def run(recording: Recording, identifier: OnlineIdentifier, size: int = 25):
    return [e for e in map(identifier.update, batches(recording, size)) if e is not None]


def errors(estimate):
    return {n: (estimate[n].value - TRUTH[n]) / estimate[n].std_dev for n in estimate.free}


def test_first_estimate_after_one_window_then_one_a_hop():
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=2.0, hop_s=0.5))
    found = run(motion(6.0), identifier)
    ends = [e.end for e in found]
    np.testing.assert_allclose(ends, 2.0 + 0.5 * np.arange(len(ends)) - 1 / RATE, atol=0.11)
    assert len(found) == 9
    for e in found:
        assert e.status is Status.CONVERGED
        # the newest samples wait until it is known whether they belong to a rest
        assert e.end - e.start == pytest.approx(2.0, abs=STILL_S + 2.5 / RATE)


def test_a_joint_that_rests_from_the_start_says_so_at_every_hop_and_is_fitted_once_it_moves(monkeypatch):
    moves, still = motion(4.0), 4 * RATE
    rest = {n: np.resize(v[:1], still) for n, v in moves.channels.items()}
    rest["link_position"] = rest["link_position"] + 1e-5 * np.random.default_rng(1).standard_normal(still)
    time = np.arange(still + len(moves)) / RATE
    whole = Recording(time, {n: np.concatenate([rest[n], v]) for n, v in moves.channels.items()}, source="robot")
    identifier = OnlineIdentifier(MODEL, ParameterSettings({"N": 50.0}), OnlineOptions(window_s=2.0, hop_s=0.1))
    joined = []
    real = SlidingWindow.recording
    monkeypatch.setattr(SlidingWindow, "recording", lambda *a: joined.append(1) or real(*a))
    resting = run(whole.slice(0, still), identifier, size=10)
    assert len(resting) > 15 and {e.status for e in resting} == {Status.NO_MOTION}
    assert len(joined) <= 41  # looked at ten times a second, and not joined for each estimate
    for e in resting:
        assert e.end - e.start == pytest.approx(2.0, abs=2.5 / RATE) and e.samples == pytest.approx(2.0 * RATE, abs=2)
        assert e.source == "robot" and "robot: The joint rests" in e.message
        assert e["N"].value == 50.0
    after = run(whole.slice(still, len(whole)), identifier, size=10)
    assert after[-1].status is Status.CONVERGED
    first = next(e for e in after if e.converged)
    assert first.end < time[still] + 2.0 + 0.1 + 0.1 + 2.0 * STILL_S


def test_warm_windows_agree_with_cold_fits_of_the_same_samples():
    """Without memory a window is fitted by itself: only the way there differs."""
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(memory_s=0.0))
    found = run(motion(6.0), identifier)
    assert len(found) > 5
    for e in found[1::3]:
        cold = fit(MODEL, motion(6.0).window(e.start, e.end + 1e-6))
        for name in e.free:
            assert abs(e[name].value - cold[name].value) < 0.2 * cold[name].std_dev, name
            assert e[name].std_dev == pytest.approx(cold[name].std_dev, rel=0.1)


def test_an_input_that_only_a_filter_derives_is_missed_while_samples_arrive_and_not_in_a_report():
    """Each window derived it by itself, and nothing more was learned after the first one."""
    model, known = build("motor_side", actuation="current"), ParameterSettings({"k_t": PositionControl.K_T, "N": 101.0})
    plant, sensors, rng = PositionControl({}, MotionOptions(), 0), ur_robot_sensors(101.0), np.random.default_rng(0)
    shown = ("link_position", "motor_velocity", "current")
    rows = [
        [float(sensors.reading(n, row[n], rng)) for n in shown] for row in (plant.tick(1 / 500) for _ in range(3000))
    ]
    record = Recording(np.arange(3000) / 500.0, dict(zip(shown, np.array(rows).T, strict=True)))
    found = run(record, OnlineIdentifier(model, known))
    assert {e.status for e in found} == {Status.MISSING_SIGNAL}
    assert "has no link_velocity" in found[-1].message and "StreamingFilter" in found[-1].message
    course = windows(model, record, known, Innovations())
    assert len({e["J_m"].value for e in course}) == len(course) > 5


def test_memory_narrows_as_the_square_root_of_what_was_seen():
    """Nothing forgotten: after five windows end to end, sigma is near that of one fit to all samples."""
    options = OnlineOptions(window_s=2.0, hop_s=2.0, memory_s=1e6)
    found = run(motion(), OnlineIdentifier(MODEL, options=options))
    first, last = found[0], found[-1]
    assert last.end == pytest.approx(20.0, abs=0.2)
    whole = fit(MODEL, motion().window(0.0, last.end + 1e-6))
    for name in ("J", "c", "tau_f"):
        # Half of the windows at least are independent of each other and in the memory, all of them at most.
        gain = first[name].std_dev / last[name].std_dev
        assert np.sqrt(len(found) / 2) * 0.8 < gain < np.sqrt(len(found)) * 1.2, name
        assert 0.8 < last[name].std_dev / whole[name].std_dev < 1.7
    assert all(abs(z) < 4.0 for z in errors(last).values())


def test_no_sample_counts_twice():
    """Many overlapping windows over one stretch teach no more than that stretch."""
    options = OnlineOptions(window_s=2.0, hop_s=0.1, memory_s=1e6)
    found = run(motion(8.0), OnlineIdentifier(MODEL, options=options))
    assert len(found) > 50
    whole = fit(MODEL, motion(8.0))
    for name in whole.free:
        assert found[-1][name].std_dev > 0.85 * whole[name].std_dev, name


@pytest.mark.parametrize("memory_s", first_quick([2.0, 0.0, 60.0]))
def test_a_joint_that_changes_is_followed(memory_s):
    """The load doubles after 10 s; 10 s later the estimate holds the new inertia."""
    time = np.arange(10 * RATE) / RATE
    torque = multisine(time, 25.0, (0.5, 1.5, 2.5, 4.0), seed=5)
    heavy = simulate(MODEL, time, {"torque": torque}, TRUTH | {"J": 3.4})
    heavy = Sensors(noise={"link_position": 1e-5}).measure(heavy, 1, keep=("link_position", "torque"))
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(memory_s=memory_s))
    assert run(motion(10.0), identifier)[-1]["J"].value == pytest.approx(1.7, rel=0.01)
    after = run(Recording(heavy.time + 10.0, heavy.channels), identifier)[-1]
    assert after["J"].value == pytest.approx(3.4, rel=0.01)


def test_time_that_goes_backwards_is_named_and_left_out():
    identifier = OnlineIdentifier(MODEL)
    record = motion(6.0)
    found = run(record.slice(0, 750), identifier)
    with pytest.raises(JointIdError, match=r"time goes backwards from 2\.99.* s to 0\.0+ s.*left out"):
        identifier.update(record.slice(0, 25))
    later = run(record.slice(750, 1500), identifier)
    undisturbed = run(record, OnlineIdentifier(MODEL))
    assert [e.values for e in (*found, *later)] == [e.values for e in undisturbed]


def test_a_check_that_does_not_end_holds_up_nothing():
    """Fits of whole windows run beside the recursion; without their results the noise levels stay."""
    waiting = []

    def never(job):
        waiting.append(job)
        return Future()

    found = run(motion(), OnlineIdentifier(MODEL, background=never))
    assert len(waiting) == 4  # profiles, a check, a second look and a second opinion: no other one as long as one runs
    assert len(found) == len(run(motion(), OnlineIdentifier(MODEL)))
    assert all(e.converged for e in found)
    assert all(abs(z) < 4.0 for z in errors(found[-1]).values())


def test_standing_still_teaches_nothing_and_forgets_nothing_at_once():
    record = motion(6.0)
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(memory_s=1e6))
    before = run(record, identifier)[-1]
    time = 6.0 + np.arange(5 * RATE) / RATE
    at_rest = Recording(time, {"link_position": np.full(len(time), 0.3), "torque": np.zeros(len(time))})
    still = run(at_rest, identifier)
    assert still[-1].status is Status.NO_MOTION
    assert "move the joint" in still[-1].message
    again = motion(4.0, 7)
    moving = run(Recording(again.time + 11.0, again.channels), identifier)[-1]
    alone = fit(MODEL, again.window(2.0, 4.0))
    assert moving.status is Status.CONVERGED
    assert moving["c"].std_dev < 0.85 * alone["c"].std_dev
    assert moving["c"].std_dev < before["c"].std_dev * 1.5
    assert all(abs(z) < 4.0 for z in errors(moving).values())


def test_a_missing_channel_or_an_empty_batch_does_no_harm():
    identifier = OnlineIdentifier(MODEL)
    assert identifier.update(Recording(np.zeros(0), {})) is None
    record = motion(4.0)
    without = Recording(record.time[:500], {"link_position": record["link_position"][:500]})
    silent = [e for e in map(identifier.update, batches(without)) if e is not None]
    assert silent[-1].status is Status.MISSING_SIGNAL
    assert "no torque" in silent[-1].message
    after = run(record.slice(500, 1000), identifier)
    assert after[-1].status is Status.CONVERGED


def test_a_recording_may_be_every_second_row_of_a_table():
    """Its arrays are then no contiguous ones."""
    whole = motion(6.0)
    thinned = whole.trusted(whole.time[::2], {n: v[::2] for n, v in whole.channels.items()}, whole.derived)
    assert not thinned.time.flags.c_contiguous
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(hop_s=0.5))
    assert [e for e in (identifier.update(thinned.slice(i, i + 50)) for i in range(0, len(thinned), 50)) if e]


def test_sliding_window_keeps_its_length_and_fills_holes_with_nan():
    window = SlidingWindow(1.5)
    window.append(Recording(np.arange(10) * 0.1, {"link_position": np.arange(10.0)}))
    window.append(Recording(1.0 + np.arange(10) * 0.1, {"torque": np.arange(10.0)}))
    held = window.recording()
    assert held.time[0] >= window.end - 1.5
    assert len(held) in (15, 16)
    torque = held["torque"]
    np.testing.assert_array_equal(torque[-10:], np.arange(10.0))
    assert np.isnan(held["link_position"][-10:]).all()


def test_an_estimate_at_every_sample_is_as_good_as_one_from_batches():
    record, last = motion(4.0), round(3.0 * RATE)
    singly = OnlineIdentifier(MODEL, options=OnlineOptions(hop_s=1.0 / RATE))
    found = run(record.slice(0, last), singly, size=1)
    assert len(found) == pytest.approx(1.0 * RATE, abs=2)
    assert all(e.converged for e in found)
    batched = run(record.slice(0, last), OnlineIdentifier(MODEL), size=25)[-1]
    same = min(found, key=lambda e: abs(e.end - batched.end))
    for name in TRUTH:
        assert abs(same[name].value - batched[name].value) < 0.1 * batched[name].std_dev
        # Blocks end elsewhere, and three of them tell the noise of the torque, which the intervals follow, to 20 %.
        assert same[name].std_dev == pytest.approx(batched[name].std_dev, rel=0.1)


def test_a_memory_that_knows_nothing_is_uninformative():
    """As soon as its doubts are as wide as the prior: it said converged, with an inertia of 0 kg m^2."""
    estimate = run(motion(4.0), OnlineIdentifier(MODEL, options=OnlineOptions(window_s=2.0, hop_s=0.5)))[-1]
    coordinates = Coordinates(MODEL, estimate.free)
    z = coordinates.z(np.array([estimate.values[n] for n in estimate.free]))
    now = z, np.diag(np.square(coordinates.spread))
    words = said(MODEL, coordinates, estimate, now, ())
    assert words.status is Status.UNINFORMATIVE and words.message.startswith("This motion shows none of the parameters")
    found = published(coordinates, estimate, now, words, {})
    assert found.status is Status.UNINFORMATIVE and not found.converged


def test_misuse_is_named_at_once():
    with pytest.raises(JointIdError, match="no parameter 'k_9'"):
        OnlineIdentifier(MODEL, ParameterSettings({"k_9": 1.0}))
    with pytest.raises(JointIdError, match="no parameter 'k_9'"):
        OnlineIdentifier(MODEL, ParameterSettings(priors={"k_9": 0.1}))
    with pytest.raises(JointIdError, match="option window_s = 0"):
        OnlineOptions(window_s=0.0)


def test_samples_that_come_at_once_are_followed_like_those_that_come_in_parts():
    """After the first fit, or a pause of the process, more than a window of samples can wait."""
    record, first = motion(12.0), 3 * RATE
    parts = run(record, OnlineIdentifier(MODEL))[-1]
    identifier = OnlineIdentifier(MODEL)
    run(record.slice(0, first), identifier)
    whole = identifier.update(record.slice(first, len(record)))
    assert parts.converged and whole.converged and whole.end == parts.end
    for name in TRUTH:
        assert abs(whole[name].value - parts[name].value) < 0.5 * parts[name].std_dev
        assert whole[name].std_dev == pytest.approx(parts[name].std_dev, rel=0.2)


def test_the_first_estimate_comes_with_the_last_sample_of_its_window_even_if_that_comes_alone():
    identifier, record = OnlineIdentifier(MODEL), motion(2.0)
    assert identifier.update(record.slice(0, len(record) - 1)) is None
    assert identifier.update(record.slice(len(record) - 1, len(record))) is not None


def test_a_pause_of_the_samples_is_no_rest():
    record, identifier = motion(12.0), OnlineIdentifier(MODEL, options=OnlineOptions(hop_s=0.1))
    run(record.slice(0, 4 * RATE), identifier)
    after = run(record.slice(8 * RATE, 9 * RATE), identifier, size=5)
    assert len(after) > 8
    assert Status.NO_MOTION not in {e.status for e in after}
