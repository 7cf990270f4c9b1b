"""From a recording to the arrays of a fit: labels, inputs, smoothing, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare, unusable
from joint_id_core.models import build
from joint_id_core.results.estimate import Status, Verdict

TIME = np.arange(200) / 100
RIGID = build("rigid_joint")


def record(**changes) -> Recording:
    channels = {"link_position": np.sin(3 * TIME), "torque": np.cos(3 * TIME)}
    return Recording(TIME, channels | changes)


def test_labels_are_the_measured_states_and_inputs_keep_their_order():
    data = prepare(RIGID, record(link_velocity=3 * np.cos(3 * TIME), current=TIME))
    assert data.labels == ("link_position", "link_velocity")
    np.testing.assert_array_equal(data.label_states, [0, 1])
    np.testing.assert_array_equal(data.u[:, 0], np.cos(3 * TIME))
    assert not data.u[:, 1].any(), "external torque is zero where it is not recorded"
    assert data.free == ("J", "c", "tau_f", "tau_0")


def test_a_derived_velocity_is_no_label():
    derived = record().with_channels({"link_velocity": 3 * np.cos(3 * TIME)}, derived=True)
    assert prepare(RIGID, derived).labels == ("link_position",)


def test_motor_side_takes_a_link_velocity_that_was_not_measured_from_its_position():
    time = np.arange(1000) / 500
    q = 0.2 * np.sin(3 * time)
    recording = Recording(time, {"link_position": q, "motor_velocity": 60.6 * np.cos(3 * time), "torque": np.cos(time)})
    data = prepare(build("motor_side"), recording)
    middle = slice(100, 900)
    np.testing.assert_allclose(data.u[middle, 2], 0.6 * np.cos(3 * data.time[middle]), atol=1e-4)
    assert data.labels == ("motor_velocity",)


def test_a_missing_input_sample_makes_the_step_longer():
    torque = np.cos(3 * TIME)
    torque[50:53] = np.nan
    data = prepare(RIGID, record(torque=torque))
    assert data.dropped == 3
    assert len(data.time) == 197
    assert data.time[50] - data.time[49] == pytest.approx(0.04)
    assert data.gap[49] == 3.0
    assert data.gap.sum() == 3.0


@pytest.mark.parametrize("every", [4, 5, 10])
def test_samples_that_are_lost_again_and_again_are_gaps(every):
    """One of a few samples is missing throughout: the period is that of the others."""
    whole = record()
    kept = np.arange(len(whole)) % every > 0
    data = prepare(RIGID, Recording(whole.time[kept], {n: v[kept] for n, v in whole.channels.items()}))
    assert data.period == pytest.approx(0.01)
    assert data.gap.sum() == pytest.approx(len(whole) // every, abs=1)
    assert data.period == pytest.approx(0.01)


def test_columns_of_a_table_are_laid_out_for_the_compiled_cell():
    table = np.column_stack([TIME, np.sin(3 * TIME), np.cos(3 * TIME)])
    data = prepare(RIGID, Recording(table[:, 0], {"link_position": table[:, 1], "torque": table[:, 2]}))
    assert data.time.flags.c_contiguous and data.y.flags.c_contiguous and data.u.flags.c_contiguous


def test_frozen_zeros_of_a_robot_are_no_measurement_but_encoder_steps_are():
    fine = 3 * np.cos(3 * TIME) + 1e-6 * np.random.default_rng(0).standard_normal(200)
    frozen = np.where(np.abs(fine) < 1.0, 0.0, fine)
    frozen[5:8] = frozen[5] + np.array([0.0, 1e-7, 2e-7])
    y = prepare(RIGID, record(link_velocity=frozen)).y[:, 1]
    repeated = np.concatenate([[False], (frozen[1:] == 0.0) & (frozen[:-1] == 0.0)])
    assert repeated.sum() > 20
    np.testing.assert_array_equal(np.isnan(y), repeated)
    steps = np.round(np.sin(3 * TIME) / 0.05) * 0.05
    assert np.isfinite(prepare(RIGID, record(link_position=steps)).y).all()


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"link_position": np.full(200, 1.0)}, Status.NO_MOTION),
        ({"link_position": np.full(200, np.nan)}, Status.MISSING_SIGNAL),
        ({"torque": np.full(200, np.nan)}, Status.MISSING_SIGNAL),
        ({"link_position": np.where(np.arange(200) < 160, np.nan, TIME)}, Status.TOO_SHORT),
    ],
)
def test_unusable_data_say_why(change, status):
    with pytest.raises(UnusableError) as error:
        prepare(RIGID, record(**change))
    assert error.value.status is status
    assert "recording" in str(error.value) and "\n" not in str(error.value)
    estimate = unusable(RIGID, "innovations", error.value, record(**change))
    assert estimate.status is status and not estimate.converged
    assert [p.name for p in estimate.parameters] == list(RIGID.parameter_names)
    assert all(np.isnan(p.std_dev) for p in estimate.parameters)
    assert estimate["N"].verdict is Verdict.FIXED


@pytest.mark.parametrize("estimator", [Innovations(), Regression()])
def test_unusable_data_keep_what_was_given(estimator):
    """A joint that rests had the values of the table: a torque constant of "nan Nm/A", held."""
    rest = record(link_position=np.full(200, 1.0), torque=np.zeros(200))
    current = Recording(rest.time, {"link_position": rest["link_position"], "current": rest["torque"]})
    settings = ParameterSettings({"k_t": 0.05, "N": 50.0, "c": 3.0}, fixed=("c",), freed=("N",))
    estimate = fit(build("rigid_joint", actuation="current"), current, settings, estimator)
    assert estimate.status is Status.NO_MOTION
    assert (estimate["k_t"].value, estimate["N"].value, estimate["c"].value) == (0.05, 50.0, 3.0)
    assert estimate["c"].verdict is estimate["k_t"].verdict is Verdict.FIXED
    assert estimate["N"].verdict is Verdict.NOT_EXCITED


def test_too_few_labels_are_told_apart_from_too_few_inputs():
    """The message names what is missing: here the inputs are complete."""
    with pytest.raises(UnusableError) as error:
        prepare(RIGID, record(link_position=np.where(np.arange(200) < 160, np.nan, TIME)))
    assert "only 40 of these a label (link_position)" in str(error.value)


def test_fixed_and_freed_names():
    p, free = ParameterSettings({"J": 2.0}, ("c",), ("N",)).applied_to(RIGID)
    assert free == ("J", "tau_f", "tau_0", "N")
    assert p[RIGID.parameter_names.index("J")] == 2.0
    with pytest.raises(JointIdError, match="no parameter 'k_9'"):
        ParameterSettings(fixed=("k_9",)).applied_to(RIGID)
    current = build("rigid_joint", actuation="current")
    with pytest.raises(JointIdError, match=r"needs k_t .* --set k_t"):
        ParameterSettings().applied_to(current)
