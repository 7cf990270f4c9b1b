"""Faults of a recording are named with their channel and samples, or refused; a good recording raises no doubt."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core import formats
from joint_id_core.checking.findings import findings
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, Regression, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.simulator import simulate

from .faulty_recordings import (
    COMMANDS,
    LATER,
    MODEL,
    TIME,
    TRUTH,
    UNEVEN,
    at_times,
    clipped,
    counts,
    drive_notes,
    frozen,
    frozen_rows,
    good,
    later,
    milliseconds,
    moved,
    only,
    scaled,
    with_rows,
    without_velocity,
    wrapped,
)

REFUSED = {
    "milliseconds": (milliseconds, "2 s apart", "seems to be in milliseconds; convert it to s (--map time_s=0.001*"),
    "microseconds": (lambda: at_times(1e6), "2000 s apart", "in microseconds; convert it to s (--map time_s=1e-6*"),
    "nanoseconds": (lambda: at_times(1e9, 1.7e18), "in nanoseconds", "convert it to s (--map time_s=1e-9*COLUMN)"),
    "no unit of time": (lambda: at_times(1e300), "2e+297 s apart", "for the motion of a joint: check its column"),
    "short milliseconds": (
        lambda: Recording(1e3 * good(500).time[::1] / 5.0, good(500).channels), "200 times", "contradict each other",
    ),
    "degrees of the position": (
        lambda: scaled("link_position", 180 / np.pi), "link_velocity is 0.01745 times", "the position is in degrees",
    ),
    "degrees alone": (
        lambda: without_velocity(scaled("link_position", 300.0)), "Channel link_position spans",
        "it is in degrees; multiply it by 0.0174533",
    ),
    "degrees of the velocity": (lambda: scaled("link_velocity", 180 / np.pi), "57.3 times", "in degrees/s"),
    "the other side of the gear": (lambda: scaled("link_velocity", 101.0), "101 times", "different sides of the gear"),
    "sign": (lambda: scaled("link_velocity", -1.0), "-1 times", "wrong sign"),
    "counts": (counts, "All values of link_position are whole numbers", "encoder counts"),
    "no torque": (lambda: scaled("torque", 0.0), "torque is zero in all samples while the joint moves", "--map"),
    "values of no joint": (
        lambda: scaled("link_position", 1e300), "link_position has 5000 values beyond 1e+09 rad", "samples 0 (0 s), ",
    ),
    "one value of no joint": (
        lambda: with_rows("torque", [700], -1e300), "torque has 1 value beyond 1e+09 Nm", "sample 700 (1.4 s); ",
    ),
    "no velocity": (lambda: scaled("link_velocity", 0.0), "link_velocity is 0 in all samples", "link_position changes"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "what", "why"), REFUSED.values(), ids=list(REFUSED))
def test_a_recording_that_contradicts_itself_is_refused(make, what, why):
    found = findings(make())
    assert found[0].fatal and what in found[0].text and why in found[0].text
    for estimator in (Regression(), None):
        estimate = fit(MODEL, make(), **({"estimator": estimator} if estimator else {}))
        assert estimate.status is Status.BAD_DATA and not estimate.converged and estimate.status.unusable
        assert what in estimate.message and why in estimate.message and estimate.message.endswith(".")


NAMED = {
    "velocity late": (lambda: later("link_velocity", 0.02), "link_velocity is late by 20 ms", "against link_position"),
    "velocity early": (lambda: later("link_velocity", -0.0053), "link_velocity is early by 5.3 ms", "link_position"),
    "position late": (lambda: later("link_position", 0.02), "link_velocity is early by 20 ms", "correct its times"),
    "torque": (lambda: with_rows("torque", list(range(5000)), 3.0), "torque is 3 in all samples", "to and fro"),
    "20 Hz": (lambda: only(good(20), "link_position", "torque"), "20 samples/s are few", "40 Hz or more"),
    "outlier": (
        lambda: with_rows("link_position", [1234], 3.0), "link_position has 1 outlier", "sample 1234 (2.468 s);",
    ),
    "outliers of the torque": (
        lambda: with_rows("torque", [100, 700, 2000, 3000], 400.0), "torque has 4 outliers",
        "samples 100 (0.2 s), 700 (1.4 s), 2000 (4 s) and 1 more",
    ),
    "zeros": (
        lambda: with_rows("link_position", list(range(2300, 2320)), 0.0), "link_position jumps to zero and back 1 time",
        "sample 2300 (4.6 s)",
    ),
    "rows that repeat": (
        lambda: frozen_rows(1010, 15), "All channels repeat the sample before 1 time", "sample 1010 (2.02 s)",
    ),
    "a position that repeats": (
        lambda: with_rows("link_position", list(range(1010, 1025)), good()["link_position"][1009]),
        "link_position repeats the value before 1 time", "sample 1010 (2.02 s)",
    ),
    "a position that stands and jumps": (
        lambda: without_velocity(frozen(good(), "link_position", 2000, 700)),
        "link_position stands still in samples 2000 to 2699 (4 to 5.398 s)", "froze",
    ),
    "a position with another zero": (
        lambda: without_velocity(good().with_channels({"link_position": good()["link_position"] + 0.3 * LATER})),
        "link_position jumps by up to 0.3", "sample 3000 (6 s)",
    ),
    "a position that wraps": (
        lambda: only(wrapped(0.5), "link_position", "torque"), "link_position wraps by 0.4985 rad, 12 times",
        "unwrap it",
    ),
    "a torque that stands": (
        lambda: frozen(good(), "torque", 1000, 300), "torque stands still 1 time",
        "in samples 1000 to 1299 (2 to 2.598 s)",
    ),
    "a torque that is cut off": (
        lambda: good().with_channels({"torque": np.clip(good()["torque"], -12.0, 12.0)}),
        "torque is cut off at -12 and 12", "% of the samples",
    ),
    "a torque of which peaks are cut off": (
        lambda: clipped(0.008, 0.992), "torque is cut off at -2", "1.6 % of the samples",
    ),
    "a torque that is cut off at one end": (
        lambda: clipped(0.0, 0.984), "torque is cut off at 1", "1.6 % of the samples",
    ),
    "a position that froze for good": (
        lambda: frozen(good(), "link_position", 1750, 3250), "link_position stands still in samples 1750 to 4999",
        "while link_velocity shows motion: the sensor froze",
    ),
    "a position that froze for good, without velocity": (
        lambda: without_velocity(frozen(good(), "link_position", 1750, 3250)), "link_position stands still in samples",
        "while torque shows motion: the sensor froze, or the joint was blocked",
    ),
    "a velocity that froze": (
        lambda: frozen(good(), "link_velocity", 1000, 60), "link_velocity stands still in samples 1000 to 1059",
        "while link_position shows motion",
    ),
    "a velocity that froze, without position": (
        lambda: only(frozen(good(), "link_velocity", 3500, 1500), "link_velocity", "torque"),
        "link_velocity stands still in samples 3500 to 4999", "while torque shows motion",
    ),
    "times of the arrival": (
        lambda: Recording(good().time + 4e-4 * UNEVEN, only(good(), "link_position", "torque").channels),
        "times scatter by", "link_position is smoother at even times, every 2",
    ),
    "calibration": (lambda: scaled("link_velocity", 1.02), "link_velocity is 1.02 times", "leave out link_velocity"),
    "scale": (lambda: scaled("link_velocity", 1.08), "link_velocity is 1.08 times", "factors of both"),
    "perhaps degrees": (
        lambda: without_velocity(good().with_channels({"link_position": good()["link_position"] + 3.0 * good().time})),
        "link_position spans", "if it is in degrees; multiply it by 0.0174533",
    ),
}  # fmt: skip


def test_a_current_of_a_slower_source_is_named():
    """As of another bus: held, a gear came out 20 % too soft in ordinary motion."""
    current = good()["torque"][np.arange(len(good())) // 2 * 2]
    channels = {"link_position": good()["link_position"], "current": current}
    found = findings(Recording(good().time, channels))
    assert any("Channel current changes with every second sample only" in f.text for f in found)
    assert not any("second sample" in f.text for f in findings(good()))


def test_currents_in_milliamperes_are_refused():
    channels = {"link_position": good()["link_position"], "current": 1e3 * good()["torque"]}
    recording = Recording(good().time, channels)
    found = findings(recording)
    assert len(found) == 1 and found[0].fatal and "Channel current seems to be in mA" in found[0].text
    model = build("rigid_joint", actuation="current")
    assert fit(model, recording, ParameterSettings({"k_t": 1.0})).status is Status.BAD_DATA


@pytest.mark.parametrize(("make", "what", "where"), NAMED.values(), ids=list(NAMED))
def test_a_fault_is_named(make, what, where):
    found = findings(make())
    assert len(found) == 1 and not found[0].fatal, [f.text for f in found]
    assert what in found[0].text and where in found[0].text
    assert "\n" not in found[0].text and not found[0].text.endswith(".")


def test_a_finding_is_told_before_what_the_residuals_show():
    estimate = fit(MODEL, with_rows("torque", [700], 400.0))
    assert "torque has 1 outlier" in estimate.notes[1] and "torque has 1 outlier" in estimate.message


@pytest.mark.parametrize("n", [2, 5])
def test_a_source_that_is_slower_than_the_recording_is_named(n):
    record = without_velocity(good())
    slow = record.with_channels({"link_position": np.repeat(record["link_position"][::n], n)})
    found = findings(slow)[0].text
    assert f"its source has {500 / n:.4g} samples/s, the recording 500" in found


def test_a_low_rate_is_named_beside_a_doubt_that_is_not_about_samples():
    found = findings(
        only(good(20).with_channels({"link_position": 300.0 * good(20)["link_position"]}), "link_position")
    )
    assert ["spans" in f.text for f in found] == [True, False] and "20 samples/s are few" in found[1].text


@pytest.mark.parametrize("torque", COMMANDS.values(), ids=list(COMMANDS))
@pytest.mark.parametrize("step", [0.0, 1e-4])
def test_commands_and_joints_at_rest_are_no_fault(torque, step):
    """Also seen by an encoder of few counts."""
    record = simulate(MODEL, TIME, {"torque": torque}, TRUTH)
    q = record["link_position"]
    seen = Recording(TIME, {"link_position": step * np.round(q / step) if step else q, "torque": torque})
    assert not [f.text for f in findings(seen) if f.about != "rate"]


KIND = {
    "seed": st.integers(0, 10_000),
    "rate": st.sampled_from([1000, 500, 250, 125, 100]),
    "noise": st.sampled_from([0.01, 1.0, 10.0, 100.0]),
}


def assert_without_doubt(seed, rate, noise):
    record = good(rate, seed, noise)
    assert not findings(record), [f.text for f in findings(record)]
    assert not drive_notes(fit(MODEL, record, estimator=Regression()))


@settings(max_examples=12, derandomize=True)  # what noise does by chance, it does once in a thousand recordings
@given(**KIND)
def test_a_good_recording_raises_no_doubt(seed, rate, noise):
    assert_without_doubt(seed, rate, noise)


@pytest.mark.long
@settings(max_examples=80, derandomize=True)
@given(**KIND)
def test_many_good_recordings_raise_no_doubt(seed, rate, noise):
    assert_without_doubt(seed, rate, noise)


def test_gaps_and_missing_values_are_no_fault_of_others():
    record = good()
    kept = np.random.default_rng(0).random(len(record)) > 0.02
    kept[1000:1100] = False
    channels = {n: v[kept] for n, v in record.channels.items()}
    channels["link_velocity"][50:90] = np.nan
    assert not findings(Recording(record.time[kept], channels))


def test_a_channel_that_the_model_does_not_use_is_no_reason_to_refuse():
    record = good().with_channels({"current": np.zeros(5000)})
    assert findings(record)[0].fatal and fit(MODEL, record, estimator=Regression()).converged


def test_info_prints_what_is_doubtful_and_a_fit_ends_with_code_2(tmp_path, run):
    file = tmp_path / "joint.csv"
    formats.write(file, milliseconds())
    code, out, _ = run("info", file)
    assert code == 0 and "wrong: The samples are 2 s apart" in out
    code, _, err = run("fit", file, "--model", "rigid_joint")
    assert code == 2 and err.startswith("joint-id: bad_data") and "(--map time_s=0.001*COLUMN)" in err


@pytest.mark.parametrize("wrong", [lambda q: 57.3 * q, lambda q: 0.0 * q, lambda q: np.roll(q, 150)])
def test_a_command_that_the_link_does_not_follow_is_named(wrong):
    record = moved()
    q = record["link_position"]
    assert not any(f.about == "command" for f in findings(record.with_channels({"reference_position": q + 0.01})))
    (found,) = (f for f in findings(record.with_channels({"reference_position": wrong(q)})) if f.about == "command")
    assert "reference_position" in found.text and not found.fatal


def test_a_joint_that_is_held_still_has_no_command_to_follow():
    record, rng = good(), np.random.default_rng(1)
    held = {"link_position": 1e-4 * rng.standard_normal(len(record)), "torque": record["torque"]}
    held["reference_position"] = 1e-6 * rng.standard_normal(len(record))
    assert not [f for f in findings(Recording(record.time, held)) if f.about == "command"]


def test_a_torque_that_no_robot_has_may_be_in_another_unit():
    (found,) = findings(scaled("torque", 1e5 / np.abs(good()["torque"]).max()))
    assert "torque seems to be in mNm" in found.text and "multiply it by 0.001" in found.text and not found.fatal


def two_sides(sign: float, motor: str, link: str, offset: float = 0.0) -> Recording:
    """A joint whose motor turns 101 times as far as its link, seen by two channels; the motor's may have an offset."""
    seen = {
        "link_position": 0.3 * np.sin(3.0 * TIME) + 0.1 * np.sin(7.0 * TIME),
        "link_velocity": 0.9 * np.cos(3.0 * TIME) + 0.7 * np.cos(7.0 * TIME),
    }
    turned = sign * 101.0 * seen[motor.replace("motor", "link")] + offset
    return Recording(TIME, {motor: turned, link: seen[link]})


@pytest.mark.parametrize("motor", ["motor_position", "motor_velocity"])
@pytest.mark.parametrize("link", ["link_position", "link_velocity"])
def test_sides_that_turn_in_opposite_directions_are_named(motor, link):
    found = [f.text for f in findings(two_sides(-1.0, motor, link))]
    assert any(f"{motor} and {link} turn in opposite directions: reverse the sign" in text for text in found)
    for offset in (0.0, 20.0, -20.0):
        assert not any("opposite" in f.text for f in findings(two_sides(1.0, motor, link, offset)))
