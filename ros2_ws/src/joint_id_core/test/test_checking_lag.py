"""A drive or a velocity that is early, late or of the wrong sign is named; so is an oscillation that samples miss."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core import formats
from joint_id_core.checking.velocity import compared
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Regression, fit
from joint_id_core.estimators.regression.drive_lag import drive_lag
from joint_id_core.estimators.shared.oscillation import fastest_oscillation, slow_samples
from joint_id_core.models import build
from joint_id_core.results.estimate import Status

from .examples import TIMES
from .faulty_recordings import (
    MODEL,
    TRUTH,
    drive_notes,
    good,
    later,
    scaled,
    with_rows,
    without_velocity,
)


@pytest.mark.parametrize("estimator", [None, Regression()])
def test_a_torque_with_the_wrong_sign_is_named(estimator):
    record = without_velocity(scaled("torque", -1.0))
    estimate = fit(MODEL, record, **({"estimator": estimator} if estimator else {}))
    assert estimate.status is Status.POOR_FIT and "acts against the motion" in estimate.message
    assert len(set(estimate.notes)) == len(estimate.notes)


@pytest.mark.parametrize(("seconds", "text"), [(-0.02, "20 ms early"), (0.02, "20 ms late"), (0.005, "5 ms late")])
def test_a_torque_that_is_early_or_late_is_named(seconds, text):
    """By either estimator, with the shift; in the record the torque is the first of two that were held."""
    record = later("torque", seconds - 0.0005)
    for estimate in (fit(MODEL, record, estimator=Regression()), fit(MODEL, record)):
        assert len(drive_notes(estimate)) == 1
        assert f"The drive seems to be {text} against the motion" in drive_notes(estimate)[0]


@settings(max_examples=15 * TIMES, derandomize=True)
@given(st.integers(0, 10_000), st.floats(-0.03, 0.03), st.sampled_from([1000, 500, 250]))
def test_the_lag_of_a_velocity_is_as_uncertain_as_it_says(seed, late, rate):
    record = good(rate, seed)
    shifted = np.interp(record.time - late, record.time, record["link_velocity"])
    shift = compared(record.with_channels({"link_velocity": shifted}), "link_position", "link_velocity")
    assert shift is not None and abs(shift.late - late) < 5.0 * shift.sigma + 2e-5
    assert shift.sigma < 2e-4


def test_of_a_long_recording_the_part_with_most_motion_tells_the_lag(monkeypatch):
    late = later("torque", 0.02)
    still = {n: np.zeros(len(late)) for n in late.channels}
    time = np.concatenate([late.time, late.time[-1] + 0.002 + late.time])
    long = Recording(time, {n: np.concatenate([still[n], late[n]]) for n in late.channels})
    monkeypatch.setattr("joint_id_core.estimators.regression.drive_lag.MOST_SAMPLES", len(late))
    assert drive_lag(long) == drive_lag(late) != ""


def test_info_names_a_late_drive_and_other_joints_that_move(tmp_path, run):
    late, still = later("torque", 0.02), with_rows("link_position", list(range(5000)), 0.2)
    late, other = (Recording(late.time, {n: r[n] for n in late.channels}) for r in (late, good(seed=1)))
    rest = Recording(still.time, {"link_position": still["link_position"] + 1e-5 * np.sin(np.arange(5000))})
    formats.write_bag(tmp_path / "bag", {"elbow": late, "wrist": other, "base": rest})
    code, out, _ = run("info", tmp_path / "bag")
    assert code == 0
    parts = {text.split(":")[0]: text for text in out.split("\njoint ")[1:]}
    assert "doubtful: The drive seems to be 20." in parts["elbow"] and "ms late" in parts["elbow"]
    assert "Other joints move at the same time: wrist (" in parts["elbow"] and "rad/s rms)" in parts["elbow"]
    assert "elbow (" in parts["wrist"] and "The drive" not in parts["wrist"]
    assert "doubtful" not in parts["base"]


@pytest.mark.parametrize(("k_1", "rate", "said"), [(1e4, 500, False), (1e4, 50, True), (1e6, 500, True)])
def test_an_oscillation_that_the_samples_do_not_show_is_named(k_1, rate, said):
    model = build("harmonic_drive")
    values = {p.name: p.nominal for p in model.parameters} | {"k_1": k_1}
    one, two = values["J_m"] * values["N"] ** 2, values["J_q"]
    frequency = np.sqrt(k_1 * (1.0 / one + 1.0 / two)) / (2.0 * np.pi)
    assert fastest_oscillation(model, values) == pytest.approx(frequency, rel=0.03)
    assert fastest_oscillation(MODEL, TRUTH | {"N": 1.0, "w_s": 1e-3}) == 0.0
    assert bool(slow_samples(model, values, rate)) is said
