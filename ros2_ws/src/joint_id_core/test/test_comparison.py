"""Comparison of models on records whose truth is known."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.comparison import comparing as comparison
from joint_id_core.comparison.comparing import compare
from joint_id_core.comparison.model_text import Candidate, parse
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import LAWS, build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .friction_record import OF_LAW, TRUTH, rigid
from .quick import first_quick


@functools.cache
def flexible() -> Recording:
    """Four seconds of a flexible joint under position control, both encoders."""
    model, time = build("harmonic_drive"), np.arange(2000) / 500
    motion = simulate_closed_loop(model, PositionController(), position_reference(), time, torque_noise=0.003, seed=1)
    noise = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1}
    return Sensors(noise=noise).measure(motion, 1, keep=(*noise, "torque"))


@functools.cache
def compared(law: str) -> comparison.Comparison:
    """Every friction law on the record that one of them made."""
    return compare(parse(["rigid_joint"], rigid(law)), rigid(law))


def labels(found: comparison.Comparison) -> list[str]:
    return [row.trial.label for row in found.ranking.rows]


def rows(found: comparison.Comparison) -> dict:
    return {row.trial.label.partition(":")[2]: row for row in found.ranking.rows}


@pytest.mark.parametrize("law", first_quick(["stribeck", "eyring"]))
def test_the_law_that_made_the_record_stands_first(law):
    found = compared(law)
    assert found.ranking.best.label == f"rigid_joint:{law}"
    others = [row for row in found.ranking.rows if row.trial.label != f"rigid_joint:{law}"]
    assert all(row.delta_bic > 100.0 for row in others)
    best = found.ranking.rows[0]
    assert all(row.score > 2.0 * best.score for row in others)
    assert set(found.ranking.signals) == {"link_position", "torque"}
    for name, value in (TRUTH | OF_LAW[law]).items():
        assert abs(best.trial.estimate[name].value - value) < 5.0 * best.trial.estimate[name].std_dev, name


@pytest.mark.long
def test_more_parameters_than_the_joint_has_gain_nothing():
    found = compared("coulomb_viscous")
    assert found.ranking.best.label == "rigid_joint:coulomb_viscous"
    assert all(row.delta_bic > 2.0 for row in found.ranking.rows[1:])


def test_too_smooth_a_step_would_show_stribeck_friction_where_there_is_none():
    """Why the smoothing is sharpened: left at the model's own, the law bends itself into a steeper step."""
    record = rigid("coulomb_viscous")
    chosen = [Candidate(law, build("rigid_joint", friction=law), ()) for law in LAWS[:2]]
    smooth = compare(chosen, record, settings=ParameterSettings({"w_s": 0.01}))
    assert [row.trial.estimate["w_s"].value for row in smooth.ranking.rows] == [0.01, 0.01]
    assert smooth.ranking.best.label == "stribeck"
    assert smooth.ranking.best.estimate["w_b"].value < 0.2 * OF_LAW["stribeck"]["w_b"]
    sharp = compared("coulomb_viscous")
    assert sharp.ranking.best.label == "rigid_joint:coulomb_viscous"
    assert sharp.ranking.best.estimate["w_s"].value < 0.01
    plain, bent = sharp.ranking.best.estimate, smooth.ranking.best.estimate
    assert plain.deviance < bent.deviance + 2.0 * np.log(bent.observations)  # for two parameters more (BIC)


def test_a_law_with_more_parameters_is_also_fitted_from_the_values_of_the_plain_one(monkeypatch):
    """On real records such a law has several minima, and one from the table's values was a poor one."""
    starts, fit = [], comparison.fit_innovations

    def spied(model, recording, settings, **others):
        starts.append((model.friction, settings.values.get("J")))
        return fit(model, recording, settings, **others)

    monkeypatch.setattr(comparison, "fit_innovations", spied)
    record = rigid("eyring")
    found = compare(parse(["rigid_joint:coulomb_viscous", "rigid_joint:eyring"], record), record)
    plain = next(row.trial.estimate["J"].value for row in found.ranking.rows if "coulomb" in row.trial.label)
    assert {law for law, start in starts if start == plain} == {"eyring"}
    assert ("eyring", None) in starts


def test_flexible_beats_rigid_on_a_flexible_joint_and_the_criterion_is_left_out():
    record = flexible()
    found = compare(parse(["rigid_joint", "harmonic_drive"], record), record, settings=ParameterSettings({"N": 101.0}))
    assert labels(found) == ["harmonic_drive:coulomb_viscous", "rigid_joint:coulomb_viscous"]
    first, second = found.ranking.rows
    assert second.score > 2.0 * first.score
    assert set(found.ranking.signals) == {"link_position", "torque"}
    assert np.isnan(first.delta_bic) and np.isnan(second.delta_bic)
    assert "different labels" in found.ranking.notes[0]
    assert len(found.ranking.notes) == 1  # one gear ratio


TWO = ["rigid_joint:coulomb_viscous", "rigid_joint:stribeck"]


def test_the_last_part_is_predicted_and_not_fitted():
    record = rigid("stribeck")
    found = compare(parse(TWO, record), record, held_out_share=0.4)
    assert (len(found.fitted), len(found.validated)) == (960, 640)
    estimate = found.ranking.rows[0].trial.estimate
    assert estimate.end == found.fitted.time[-1] < found.validated.time[0]
    spoiled = record["link_position"].copy()
    spoiled[960:] += 0.1 * np.sin(40.0 * record.time[960:])
    other = compare(parse(TWO, record), record.with_channels({"link_position": spoiled}), held_out_share=0.4)
    again = rows(other)["stribeck"]
    assert again.trial.estimate.values == estimate.values
    assert again.score > 10.0 * found.ranking.rows[0].score


def test_another_recording_is_predicted_where_one_is_given():
    record, other = rigid("stribeck"), rigid("stribeck", 3)
    found = compare(parse(TWO, record), record, other)
    assert found.fitted is record and found.validated is other
    assert found.ranking.best.label == "rigid_joint:stribeck"
    assert rows(found)["stribeck"].trial.estimate.samples == len(record)


def test_a_cut_connection_in_the_unseen_part_is_no_error_of_a_model():
    record = rigid("stribeck")
    keep = np.r_[0:1200, 1350:1600]
    cut = Recording(record.time[keep], {n: v[keep] for n, v in record.channels.items()})
    found = compare(parse(TWO, cut), cut, held_out_share=0.4)
    assert found.ranking.best.label == "rigid_joint:stribeck"
    assert found.ranking.rows[0].trial.nrmse["link_position"] < 1e-3


def test_candidates_that_fail_stay_with_the_reason():
    record = rigid("coulomb_viscous")
    found = compare(parse(["dc_motor", "rigid_joint"], record), record)
    assert labels(found) == ["rigid_joint:coulomb_viscous", "dc_motor:coulomb_viscous"]
    last = found.ranking.rows[-1]
    assert (last.rank, last.trial.estimate.status) == (None, Status.MISSING_SIGNAL)
    assert "no voltage" in last.reason
    assert "-" in str(found)


def test_a_candidate_that_runs_away_does_not_end_the_others(monkeypatch):
    fit = comparison.fit_innovations

    def runs_away(model, *arguments, **options):
        if model.friction == "eyring":
            raise np.linalg.LinAlgError("Singular matrix")
        return fit(model, *arguments, **options)

    monkeypatch.setattr(comparison, "fit_innovations", runs_away)
    record = rigid("coulomb_viscous")
    found = compare(parse(["rigid_joint", "rigid_joint:eyring"], record), record)
    assert found.ranking.best.label == "rigid_joint:coulomb_viscous"
    assert found.ranking.rows[-1].trial.estimate.status is Status.DIVERGED
    assert "Singular matrix" in found.ranking.rows[-1].reason


def test_a_validation_recording_without_the_signals_of_a_model_says_so():
    record = flexible()
    other = Recording(record.time, {n: record[n] for n in ("link_position", "torque")}, source="other.csv")
    chosen = parse(["rigid_joint", "motor_side"], record)
    found = compare(chosen, record, other, settings=ParameterSettings({"N": 101.0}))
    assert labels(found) == ["rigid_joint:coulomb_viscous", "motor_side:coulomb_viscous"]
    assert "could not be validated: other.csv measures none" in found.ranking.rows[-1].reason


def half_still(moving_first: bool) -> Recording:
    """A record whose joint moves in one half only, and shakes by its sensor's noise in the other."""
    record = rigid("coulomb_viscous")
    moves = (np.arange(len(record)) < len(record) // 2) == moving_first
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(record))
    return record.with_channels({"link_position": np.where(moves, record["link_position"], noise)})


@pytest.mark.parametrize(
    ("record", "options", "says"),
    [
        (
            rigid("stribeck"),
            {"settings": ParameterSettings({"k_9": 1.0})},
            "no candidate has a parameter 'k_9': there are J, c, tau_f",
        ),
        (rigid("stribeck"), {"settings": ParameterSettings(fixed={"k_1"})}, "no candidate has a parameter 'k_1'"),
        (rigid("stribeck"), {"settings": ParameterSettings(freed={"k_2"})}, "no candidate has a parameter 'k_2'"),
        (rigid("stribeck"), {"settings": ParameterSettings({"J": -1.0})}, "J = -1 kg m.2 is outside its bounds"),
        (rigid("stribeck"), {"held_out_share": 1.0}, "between 0 and 1"),
        (rigid("stribeck"), {"held_out_share": float("nan")}, "between 0 and 1"),
        (rigid("stribeck"), {"held_out_share": 0.98}, "32 samples are left to fit, a fit needs 50"),
        (rigid("stribeck"), {"held_out_share": 0.1}, "part to predict holds 160 samples, 0.4 s"),
        (rigid("stribeck").slice(0, 0), {}, "0 samples are left to fit"),
        (rigid("stribeck"), {"validation": rigid("stribeck").slice(0, 0)}, "part to predict holds 0 samples"),
        (half_still(True), {"held_out_share": 0.5}, "hardly moves in the part to predict"),
        (half_still(False), {"held_out_share": 0.5}, "hardly moves in the part to fit"),
    ],
)
def test_misuse_and_parts_that_show_nothing_are_refused(record, options, says):
    with pytest.raises(JointIdError, match=says):
        compare(["rigid_joint"], record, **options)
