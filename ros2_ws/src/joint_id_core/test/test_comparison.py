"""Comparison of models on records whose truth is known, and `joint-id compare`."""

from __future__ import annotations

import functools
import json
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.comparison import comparing as comparison
from joint_id_core.comparison.comparing import compare
from joint_id_core.comparison.model_text import Candidate, parse
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import LAWS, build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import multisine, position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}
OF_LAW = {"coulomb_viscous": {}, "stribeck": {"dtau_s": 1.0, "w_b": 0.2}, "eyring": {"w_e": 0.5}}


@functools.cache
def rigid(law: str, seed: int = 0) -> Recording:
    """Four seconds of a rigid joint with exact stick and slip, reversing often, torque with noise."""
    time = np.arange(1600) / 400
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(len(time))
    motion = simulate(build("rigid_joint", friction=law), time, {"torque": torque + noise}, TRUTH | OF_LAW[law])
    seen = Sensors(noise={"link_position": 1e-5}).measure(motion, seed, keep=("link_position",))
    return replace(seen.with_channels({"torque": torque}), source="joint")


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


@pytest.mark.parametrize("law", ["stribeck", "eyring"])
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
    assert smooth.ranking.best.estimate["w_b"].value < 0.01
    sharp = compared("coulomb_viscous")
    assert sharp.ranking.best.label == "rigid_joint:coulomb_viscous"
    assert sharp.ranking.best.estimate["w_s"].value < 0.01
    assert sharp.ranking.best.estimate.deviance < smooth.ranking.best.estimate.deviance


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


@pytest.fixture
def file(tmp_path):
    """A CSV file of a joint with Stribeck friction."""
    path = tmp_path / "joint.csv"
    formats.write_csv(path, rigid("stribeck"))
    return path


def test_the_command_prints_a_table_and_what_to_do_next(file, run):
    code, out, err = run("compare", file)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("fitted: ") and "1067 samples" in lines[0]
    places = [line.split()[:3] for line in lines if line.startswith("  ") and "converged" in line]
    assert places[0] == ["1", "rigid_joint:stribeck", "converged"]
    assert {place[1] for place in places} == {f"rigid_joint:{law}" for law in LAWS}
    assert "rigid_joint:stribeck describes this record best" in out
    command = lines[-1].partition("joint-id ")[2].split()
    assert command[:6] == ["fit", str(file), "--model", "rigid_joint", "--friction", "stribeck"]
    code, again, _ = run(*command, "--json")
    assert code == 0
    assert json.loads(again)["status"] == "converged"


def test_json_keeps_the_contract(file, run):
    arguments = ["--models", "rigid_joint:stribeck,rigid_joint", "--models", "dc_motor", "--fix", "J=1.7", "--json"]
    code, out, err = run("compare", file, *arguments)
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["best"] == "rigid_joint:stribeck"
    assert result["decided_by"] == ["link_position", "torque"]
    assert isinstance(result["conclusion"], str)
    assert {"source", "samples", "start_s", "end_s"} == set(result["fitted"]) == set(result["predicted"])
    assert result["fit_arguments"][:4] == ["--model", "rigid_joint", "--friction", "stribeck"]
    assert result["fit_arguments"][4:6] == ["--fix", "J=1.7"]
    first, second, last = result["candidates"]
    assert (first["rank"], second["rank"], last["rank"]) == (1, 2, None)
    assert first["delta_bic"] == 0.0 < second["delta_bic"]
    assert first["free_parameters"] == 5
    assert first["observations"] == result["fitted"]["samples"]
    assert first["bic"] == pytest.approx(first["aic"] + 5 * (np.log(first["observations"]) - 2.0))
    drive = {h["signal"]: h for h in first["held_out"]}["torque"]
    assert drive["r_squared"] == pytest.approx(1.0 - drive["nrmse"] ** 2)
    assert {p["name"]: p["value"] for p in first["estimate"]["parameters"]}["J"] == 1.7
    assert last["status"] == "missing_signal" and last["bic"] is None and last["held_out"] == []


def test_none_that_describes_the_record_is_exit_code_1(tmp_path, run):
    rng = np.random.default_rng(0)
    noise = {"link_position": rng.standard_normal(800), "torque": rng.standard_normal(800)}
    formats.write_csv(tmp_path / "noise.csv", Recording(np.arange(800) / 250, noise))
    code, out, err = run("compare", tmp_path / "noise.csv", "--models", "rigid_joint,rigid_joint:eyring")
    assert code == 1
    assert "no candidate describes this record" in out
    assert err.startswith("joint-id: no candidate") and err.count("\n") == 1
    assert "joint-id fit" not in out


def test_signals_that_no_candidate_finds_are_bad_input(file, run):
    code, out, err = run("compare", file, "--models", "dc_motor")
    assert code == 2
    assert "missing_signal" in out
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--models", "pendulum"], "no model 'pendulum'; write MODEL[:LAW]"),
        (["--models", "rigid_joint:magic,rigid_joint"], "no friction law 'magic'"),
        (["--models", "rigid_joint:gravity,rigid_joint"], "no friction law 'gravity'"),
        (["--models", "rigid_joint+wings"], "no option 'wings'"),
        (["--models", "dc_motor+gravity"], "model dc_motor has no option 'gravity'"),
        (["--models", "rigid_joint,rigid_joint:coulomb_viscous"], "rigid_joint:coulomb_viscous is given twice"),
        (["--models", "rigid_joint:eyring"], "rigid_joint:eyring alone is no comparison"),
        (["--models", "rigid_joint+torque+current"], "contradict or repeat"),
        (["--models", "rigid_joint,,"], "no model ''"),
        (["--models", "rigid_joint+current"], "needs k_t"),
        (["--set", "k_9=1"], "no candidate has a parameter 'k_9'"),
        (["--set", "J"], "--set J: not of the form NAME=VALUE"),
        (["--set", "tau_f=0"], "needs a start above zero"),
        (["--held-out", "2"], "between 0 and 1"),
        (["--held-out", "0.5", "--validate", "{file}"], "exclude each other"),
        (["--validate", "none.csv"], "none.csv"),
        (["--start", "99"], "no sample between"),
        (["--end", "1"], "part to predict"),
        (["--map", "speed=torque"], "cannot map to 'speed'"),
        (["--bogus"], "--bogus"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(file, run, arguments, says):
    code, out, err = run("compare", file, *[a.format(file=file) for a in arguments])
    assert (code, out) == (2, "")
    assert err.startswith("joint-id: ") and err.count("\n") == 1
    assert says in err
