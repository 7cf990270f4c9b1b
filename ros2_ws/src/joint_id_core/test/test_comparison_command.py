"""`joint-id compare`: its table, its JSON, and what it says of bad input."""

from __future__ import annotations

import json

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.models import LAWS

from .friction_record import rigid


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
    assert 0.9 * result["fitted"]["samples"] < first["observations"] < result["fitted"]["samples"]  # less the rests
    assert first["bic"] == pytest.approx(first["aic"] + 5 * (np.log(first["observations"]) - 2.0))
    drive = {h["signal"]: h for h in first["held_out"]}["torque"]
    assert drive["r_squared"] == pytest.approx(1.0 - drive["nrmse"] ** 2)
    assert {p["name"]: p["value"] for p in first["estimate"]["parameters"]}["J"] == 1.7
    assert last["status"] == "missing_signal" and last["bic"] is None and last["held_out"] == []


@pytest.mark.long
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
