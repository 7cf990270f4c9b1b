"""Stiffness from two noisy encoders: what least squares makes of it, instruments, the lag of an encoder."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, Regression, fit
from joint_id_core.estimators.regression.covariance import jackknife
from joint_id_core.estimators.regression.instruments import projected, shown
from joint_id_core.estimators.regression.least_squares import two_stage
from joint_id_core.filtering.offline import complete
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.results.verdict import Verdict

from .controlled_joint import TRUTH as RIGID_TRUTH
from .controlled_joint import controlled
from .flexible_joint import TRUTH, flexible, late, stiffer
from .gear_with_play import CALM, moved
from .online_motion import batches
from .quick import first_quick

MODEL, DELAYED = build("motor_side"), build("motor_side", delays=True)
PLAY_TRUTH = build("harmonic_drive").values()
FRICTION = ParameterSettings({"w_sm": TRUTH["w_sm"]})


def regressed(recording: Recording, settings: ParameterSettings = FRICTION, delays: bool = False) -> Estimate:
    return fit(DELAYED if delays else MODEL, recording, settings, Regression())


def alone(recording: Recording) -> Recording:
    """The recording without the command."""
    return Recording(recording.time, {n: v for n, v in recording.channels.items() if n != "reference_position"})


def test_noise_of_a_column_makes_least_squares_small_but_not_two_stages():
    """The attenuation is that of the share of noise in the column (Fuller, Measurement Error Models, 1987, 1.1.7)."""
    rng, t = np.random.default_rng(0), np.arange(20000) / 100.0
    true = np.sin(t) + 0.5 * np.sin(2.7 * t)
    noisy, tools = true + 0.5 * rng.standard_normal(len(t)), np.column_stack([np.sin(t), np.sin(2.7 * t)])
    y = 3.0 * true + 0.1 * rng.standard_normal(len(t))
    least = np.linalg.lstsq(noisy[:, None], y, rcond=None)[0][0]
    share = np.var(true) / (np.var(true) + 0.25)
    assert least == pytest.approx(3.0 * share, rel=0.02)
    assert two_stage(y, noisy[:, None], tools)[0] == pytest.approx(3.0, rel=0.01)


def test_two_stages_with_the_columns_as_instruments_are_least_squares():
    rng = np.random.default_rng(1)
    columns, y = rng.standard_normal((100, 3)), rng.standard_normal(100)
    assert np.allclose(two_stage(y, columns, columns), np.linalg.lstsq(columns, y, rcond=None)[0])
    assert np.allclose(projected(columns, columns), columns)


def test_the_jackknife_of_independent_samples_is_the_covariance_of_least_squares():
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((4000, 2)) * [1.0, 1e4]
    found = []
    for _ in range(40):
        y = columns @ [2.0, 3.0] + rng.standard_normal(4000)
        found.append(np.diag(jackknife(lambda kept, y=y: two_stage(y[kept], columns[kept], columns[kept]), 4000, 1.0)))
    widened = (2.262 / 1.96) ** 2
    assert np.allclose(np.mean(found, axis=0) / widened, np.diag(np.linalg.inv(columns.T @ columns)), rtol=0.3)


def test_a_column_that_the_instruments_do_not_show_is_not_used():
    rng = np.random.default_rng(3)
    tools = rng.standard_normal((500, 2))
    columns = np.column_stack([tools[:, 0], rng.standard_normal(500), tools[:, 1] + 0.3 * rng.standard_normal(500)])
    assert shown(columns, tools, np.zeros(3, dtype=bool)).tolist() == [True, False, True]


@pytest.mark.long
@pytest.mark.parametrize("disturbance", [0.0, 0.01])
def test_values_are_right_within_their_intervals_whatever_the_disturbance(disturbance):
    names, off = ("J_m", "c_m", "tau_fm", "k_1"), []
    for seed in range(4):
        found = regressed(flexible(seed, disturbance=disturbance))
        assert found.converged
        off.append([(found[n].value - TRUTH[n]) / found[n].std_dev for n in names])
        assert found["k_1"].verdict is Verdict.ESTIMATED
    assert np.abs(off).max() < 4.0 and np.sqrt(np.mean(np.square(off))) < 2.0


def test_noise_of_the_encoders_does_not_make_the_stiffness_small():
    """Plain least squares finds a tenth less: the noise has a tenth of the power of the twist."""
    record = flexible(0, noise=3e-4)
    found = regressed(record, ParameterSettings({**FRICTION.values, "J_m": TRUTH["J_m"], "k_2": 0.0}, ("J_m", "k_2")))
    assert abs(found["k_1"].value - TRUTH["k_1"]) < 3.0 * found["k_1"].std_dev < 0.3 * TRUTH["k_1"]


def test_without_the_command_the_measured_motion_serves():
    record = flexible(1)
    with_command, without = regressed(record)["k_1"], regressed(alone(record))["k_1"]
    assert with_command.value == pytest.approx(without.value, rel=0.02)


def test_a_command_in_another_unit_is_not_used():
    record = flexible(1)
    degrees = record.with_channels({"reference_position": np.rad2deg(record["reference_position"])})
    assert regressed(degrees)["k_1"].value == regressed(alone(record))["k_1"].value


def test_a_gear_that_stiffens_under_load_is_found():
    record = flexible(2, k_2=9e8)
    found = regressed(record)
    assert found["k_2"].verdict is Verdict.ESTIMATED
    assert abs(found["k_2"].value - 9e8) < 3.0 * found["k_2"].std_dev
    assert abs(found["k_1"].value - TRUTH["k_1"]) < 3.0 * found["k_1"].std_dev


def test_a_late_encoder_is_found_and_hides_on_which_side_viscous_friction_is():
    found = regressed(late(flexible(0), 0.003), delays=True)
    assert abs(found["delta_q"].value - 0.003) < 2.0 * found["delta_q"].std_dev < 0.001
    assert abs(found["k_1"].value - TRUTH["k_1"]) < 3.0 * found["k_1"].std_dev
    assert found["c_m"].verdict is Verdict.PRIOR and abs(found["c_m"].value - TRUTH["c_m"]) < found["c_m"].std_dev
    at = [found.free.index(n) for n in ("c_m", "delta_q")]
    block = found.covariance[np.ix_(at, at)]
    assert block[0, 1] / np.sqrt(block[0, 0] * block[1, 1]) > 0.8


def test_a_late_encoder_that_the_model_cannot_have_is_named():
    found = regressed(late(flexible(0), 0.01))
    assert found.status is Status.POOR_FIT and "--delays" in found.message
    assert "10 ms late" in found.message or "9.9" in found.message


def test_what_is_beyond_instruments_keeps_its_value_and_is_named():
    found = regressed(flexible(0), FRICTION.with_values({"c_1": 7.0}))
    assert found["c_1"].verdict is Verdict.FIXED and found["c_1"].value == 7.0
    assert any("c_1" in note and "cannot tell" in note for note in found.notes)


def test_a_gear_that_the_instruments_do_not_show_leaves_nothing_of_the_motor_known():
    """In calm motion the twist goes with friction: what is left holds the link as well, twice the motor's inertia."""
    recording = moved(0.0, CALM, 1)
    found = fit(MODEL, recording, estimator=Regression())
    assert found.status is Status.UNINFORMATIVE
    assert {row.verdict for row in found.parameters if row.name in found.free} == {Verdict.NOT_EXCITED}
    assert "together with that of the link" in found["J_m"].reason
    both = fit(MODEL, recording)
    assert both.converged
    for name in ("J_m", "c_m", "tau_fm"):
        true = PLAY_TRUTH[name]
        assert abs(both[name].value - true) < 3.0 * both[name].std_dev < 0.3 * true, name


def test_a_delay_against_the_drive_is_refused():
    with pytest.raises(JointIdError, match="does not shift the drive by delta_p"):
        regressed(flexible(0), ParameterSettings({"delta_p": 0.002}, ("delta_p",)), delays=True)


@pytest.mark.long
def test_a_search_for_a_joint_far_from_the_table_starts_where_the_regression_is():
    """Of an industrial robot; without such starts the search ends three decades too low."""
    factor = 1000.0
    record = stiffer(flexible(0, disturbance=0.002), factor)
    found = fit(MODEL, record, FRICTION)
    assert found["k_1"].initial == pytest.approx(factor * TRUTH["k_1"], rel=0.2)
    assert found["k_1"].value == pytest.approx(factor * TRUTH["k_1"], rel=0.1)
    assert found["J_m"].value == pytest.approx(factor * TRUTH["J_m"], rel=0.1)
    own = fit(MODEL, record, FRICTION.with_values({"k_1": 4e6}))
    assert own["k_1"].initial == 4e6


@pytest.mark.long
def test_online_it_starts_there_as_well_also_after_a_restart():
    record = complete(stiffer(flexible(0, disturbance=0.0005), 1000.0))  # as the filter does while samples arrive
    options = OnlineOptions(window_s=6.0, hop_s=1.0)
    first = OnlineIdentifier(MODEL, FRICTION, options)
    found = [e for part in batches(record.slice(0, 2501)) if (e := first.update(part)) is not None]
    good = [e for e in found if e.converged][-1]
    assert good["k_1"].initial == pytest.approx(1000.0 * TRUTH["k_1"], rel=0.3)
    assert good["k_1"].value == pytest.approx(1000.0 * TRUTH["k_1"], rel=0.2)
    second = OnlineIdentifier(MODEL, FRICTION, options)
    second.resume(good, 10.0)
    later = [e for part in batches(record.slice(2501, len(record))) if (e := second.update(part)) is not None]
    assert later[-1].converged and later[-1]["k_1"].initial == good["k_1"].initial
    assert later[-1]["k_1"].value == pytest.approx(1000.0 * TRUTH["k_1"], rel=0.1)


def test_a_search_near_the_table_starts_at_the_table():
    assert fit(MODEL, flexible(0), FRICTION)["k_1"].initial == TRUTH["k_1"]


@pytest.mark.long
def test_intervals_of_a_search_are_no_smaller_where_the_residual_torque_has_a_memory():
    record = flexible(0, disturbance=0.02)
    found, other = fit(MODEL, record, FRICTION), regressed(record)
    assert found.status in (Status.CONVERGED, Status.DISAGREE, Status.POOR_FIT)
    if found.converged:
        assert any("memory" in note for note in found.notes)
        for name in ("J_m", "k_1", "tau_fm"):
            assert found[name].std_dev > 0.9 * other[name].std_dev


@pytest.mark.parametrize("noise", first_quick([3e-3, 1e-2]))
def test_the_command_as_instrument_finds_the_inertia_in_a_band_full_of_noise(noise):
    """Noise of the acceleration makes least squares small; the command has none of it (Janot et al. 2014)."""
    record, model = controlled(0.3, 0.3, noise=noise), build("rigid_joint")
    least, command = (
        fit(model, record, None, Regression(band_hz=6.0, instruments=choice))["J"]
        for choice in ("automatic", "command")
    )
    assert least.value < 0.85 * RIGID_TRUTH["J"]
    assert abs(command.value - RIGID_TRUTH["J"]) < 3.0 * command.std_dev < 0.5 * RIGID_TRUTH["J"]


def test_motion_and_command_as_instruments_agree_on_a_stiffness():
    own, other = (
        fit(MODEL, flexible(0), FRICTION, Regression(instruments=choice))["k_1"] for choice in ("motion", "command")
    )
    assert own.value != other.value
    assert abs(own.value - other.value) < own.std_dev


def test_a_command_that_is_asked_for_and_missing_is_named():
    with pytest.raises(JointIdError, match=r"instruments = command: .* has no reference_position"):
        fit(MODEL, alone(flexible(0)), FRICTION, Regression(instruments="command"))
    with pytest.raises(JointIdError, match="choose one of automatic, command, motion"):
        Regression(instruments="gravity")
