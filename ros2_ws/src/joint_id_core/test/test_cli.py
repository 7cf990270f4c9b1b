"""What a user of `joint-id` relies on: results on stdout, one line on stderr, exit codes."""

import json

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.models import MODELS, build


@pytest.fixture
def motor(tmp_path, run):
    """Two seconds of a simulated motor."""
    path = tmp_path / "motor.csv"
    assert run("simulate", "dc_motor", "--out", path, "--duration", "2", "--rate", "1000", "--seed", "3")[0] == 0
    return path


def complaint(result):
    """The one line of a command that was given bad input."""
    code, out, err = result
    assert code == 2
    assert out == ""
    assert err.startswith("joint-id: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("model", MODELS)
def test_simulate_writes_what_the_model_has(model, tmp_path, run):
    path = tmp_path / "made.csv"
    code, out, err = run("simulate", model, "--out", path, "--duration", "0.3", "--no-noise", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["truth"] == build(model).values()
    recording = formats.read(path)
    assert len(recording) == result["samples"] == 151
    built = build(model)
    needed = {*built.state_names, *built.input_names} - {"external_torque"}
    assert set(recording.channels) == needed
    moved = recording[built.state_names[-1]]
    assert np.ptp(moved) > 0.0


def test_simulate_takes_the_model_as_other_commands_do(run, tmp_path):
    """It was the argument only, and `--model` no option."""
    for k, words in enumerate((["rigid_joint"], ["--model", "rigid_joint"], ["rigid_joint", "--model", "rigid_joint"])):
        code, out, err = run("simulate", *words, "-o", tmp_path / f"{k}.csv", "--duration", "0.3")
        assert code == 0 and "tau_f" in out, err


def test_simulate_is_repeatable_and_the_seed_changes_only_the_noise(tmp_path, run):
    made = {}
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        path = tmp_path / f"{name}.csv"
        run("simulate", "harmonic_drive", "--out", path, "--duration", "0.2", "--seed", seed, "--set", "k_1=6000")
        made[name] = formats.read(path)["motor_velocity"]
    np.testing.assert_array_equal(made["a"], made["b"])
    assert 0.0 < np.max(np.abs(made["a"] - made["c"])) < 10 * 1.5e-3 * 101


def test_simulate_to_a_bag_and_info_of_it(tmp_path, run):
    bag = tmp_path / "bag"
    assert run("simulate", "harmonic_drive", "--out", bag, "--duration", "0.5", "--joint", "elbow")[0] == 0
    code, out, _ = run("info", bag, "--json")
    assert code == 0
    (joint,) = json.loads(out)["joints"]
    assert joint["joint"] == "elbow"
    assert joint["samples"] == 251
    assert joint["rate_hz"] == pytest.approx(500.0)
    assert joint["duration_s"] == pytest.approx(0.5)
    assert {c["name"] for c in joint["channels"]} == {"motor_position", "motor_velocity", "link_position", "torque"}
    text = run("info", bag)[1]
    assert "joint elbow: 251 samples, 0.5 s, 500 Hz, 0 gaps" in text


def test_info_tells_of_gaps_missing_values_and_unknown_columns(tmp_path, run):
    path = tmp_path / "log.csv"
    path.write_text(
        "time_s,link_position,torque,temp,n\n0,1,2,40,1\n0.1,,2,40,1\n0.2,3,nan,41,1\n0.5,4,2,42,1\n0.6,5,7,42,1\n"
    )
    result = json.loads(run("info", path, "--json")[1])
    assert result["unknown"] == ["temp", "n"]
    (facts,) = result["joints"]
    assert facts["gaps"] == 1
    assert facts["rate_hz"] == pytest.approx(10.0)
    by_name = {c["name"]: c for c in facts["channels"]}
    assert by_name["link_position"] == {
        "name": "link_position", "unit": "rad", "derived": False, "minimum": 1.0, "maximum": 5.0, "missing": 1,
    }  # fmt: skip
    assert by_name["torque"]["missing"] == 1
    mapped = json.loads(run("info", path, "--json", "--map", "current=0.5*temp")[1])
    assert mapped["unknown"] == ["n"]
    assert {c["name"]: c["maximum"] for c in mapped["joints"][0]["channels"]}["current"] == 21.0


def test_fit_finds_the_truth_and_keeps_the_contract(motor, run):
    code, out, err = run("fit", motor, "--model", "dc_motor", "--set", "k_t=0.07", "--set", "R=0.4", "--json")
    assert code == 0
    assert err == ""
    result = json.loads(out)
    assert result["model"] == "dc_motor"
    assert result["status"] == "converged"
    assert isinstance(result["message"], str)
    assert result["elapsed_s"] > 0.0
    assert {f["signal"]: f["nrmse"] < 0.05 for f in result["fit"]} == {"current": True, "motor_velocity": True}
    truth = build("dc_motor").values()
    assert [p["name"] for p in result["parameters"]] == list(truth)
    for p in result["parameters"]:
        assert set(p) >= {"name", "unit", "value", "std_dev", "verdict"}
        if p["verdict"] == "estimated":
            assert abs(p["value"] - truth[p["name"]]) < 4.0 * p["std_dev"], p["name"]
    verdicts = {p["name"]: p["verdict"] for p in result["parameters"]}
    assert verdicts["R"] == verdicts["k_b"] == verdicts["k_t"] == "estimated"
    assert verdicts["L"] == verdicts["J_r"] == "fixed"


def test_fit_holds_cuts_and_validates(motor, tmp_path, run):
    picture, other = tmp_path / "fit.png", tmp_path / "other.csv"
    assert run("simulate", "dc_motor", "--out", other, "--duration", "2", "--rate", "1000", "--seed", "4")[0] == 0
    code, out, err = run(
        "fit", motor, "--model", "dc_motor", "--fix", "R=0.4932", "--fix", "k_b",
        "--start", "0.2", "--end", "1.6", "--validate", other, "--plot", picture, "--json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    result = json.loads(out)
    by_name = {p["name"]: p for p in result["parameters"]}
    assert by_name["R"]["value"] == 0.4932
    assert by_name["R"]["verdict"] == by_name["k_b"]["verdict"] == "fixed"
    assert all(v["nrmse"] < 0.05 for v in result["validation"])
    assert {v["signal"] for v in result["validation"]} == {"current", "motor_velocity"}
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_fit_table_names_every_parameter_with_its_unit(motor, run):
    code, out, err = run("fit", motor, "--model", "dc_motor")
    assert (code, err) == (0, "")
    for p in build("dc_motor").parameters:
        assert p.name in out
        assert p.unit in out


def test_a_model_that_does_not_describe_the_data_is_no_success(tmp_path, run):
    rng = np.random.default_rng(0)
    time = np.arange(1000) / 500
    noise = {"link_position": rng.standard_normal(1000), "torque": rng.standard_normal(1000)}
    formats.write_csv(tmp_path / "noise.csv", Recording(time, noise))
    code, out, err = run("fit", tmp_path / "noise.csv", "--model", "rigid_joint", "--json")
    assert code == 1
    assert json.loads(out)["status"] != "converged"
    assert err.count("\n") == 1


def test_map_brings_foreign_columns_in(tmp_path, run):
    made = tmp_path / "made.csv"
    run("simulate", "rigid_joint", "--out", made, "--duration", "2", "--set", "J=2")
    foreign = tmp_path / "foreign.csv"
    foreign.write_text(made.read_text().replace("time_s,link_position,torque", "t,qm,tau", 1))
    arguments = ["--map", "time_s=t", "--map", "link_position=qm", "--map", "torque=tau", "--json"]
    code, out, _ = run("fit", foreign, "--model", "rigid_joint", *arguments)
    assert code == 0
    inertia = {p["name"]: p for p in json.loads(out)["parameters"]}["J"]
    assert abs(inertia["value"] - 2.0) < 4.0 * inertia["std_dev"]


def test_free_estimates_what_the_model_holds(tmp_path, run):
    made = tmp_path / "made.csv"
    run("simulate", "rigid_joint", "--out", made, "--duration", "2", "--set", "N=50")
    arguments = ["--model", "rigid_joint", "--set", "N=40", "--free", "N", "--fix", "J=1", "--json"]
    code, out, _ = run("fit", made, *arguments)
    assert code == 0
    ratio = {p["name"]: p for p in json.loads(out)["parameters"]}["N"]
    assert ratio["verdict"] == "estimated"
    assert abs(ratio["value"] - 50.0) < 4.0 * ratio["std_dev"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fit", "{motor}", "--model", "pendulum"], "option model = 'pendulum': choose one of dc_motor"),
        (["fit", "{motor}", "--model", "dc_motor", "--set", "k_9=1"], "no parameter 'k_9'"),
        (["fit", "{motor}", "--model", "dc_motor", "--fix", "k_9"], "no parameter 'k_9'"),
        (["fit", "{motor}", "--model", "dc_motor", "--set", "R=-1"], "outside its bounds"),
        (["fit", "{motor}", "--model", "dc_motor", "--set", "R=big"], "'big' is not a number"),
        (["fit", "{motor}", "--model", "dc_motor", "--set", "R"], "--set R: not of the form NAME=VALUE"),
        (["fit", "{motor}", "--model", "dc_motor", "--set", "R=1", "--set", "R=2"], "given twice"),
        (["fit", "{motor}", "--model", "dc_motor", "--gravity"], "no option 'gravity'"),
        (
            ["fit", "{motor}", "--model", "dc_motor", "--friction", "none"],
            "option friction = 'none': choose one of coulomb_viscous",
        ),
        (
            ["fit", "{motor}", "--model", "rigid_joint", "--actuation", "steam"],
            "option actuation = 'steam': choose one of",
        ),
        (["fit", "{motor}", "--model", "dc_motor", "--estimator", "magic"], "magic"),
        (["fit", "{motor}", "--model", "dc_motor", "--start", "99"], "no sample between"),
        (["fit", "{motor}", "--model", "dc_motor", "--map", "speed=current"], "cannot map to 'speed'"),
        (["fit", "{motor}", "--model", "dc_motor", "--plot", "{tmp}/no/such/x.png"], "does not exist: create it"),
        (["fit", "{motor}", "--model", "dc_motor", "--plot", "{tmp}/x.doc"], "not a picture format"),
        (["fit", "{tmp}/none.csv", "--model", "dc_motor"], "none.csv"),
        (["fit", "{tmp}/empty.mcap", "--model", "dc_motor"], "empty"),
        (["fit", "{motor}", "--set", "k_9=1"], "no parameter 'k_9'"),
        (["fit", "{motor}", "--model", "dc_motor", "--bogus"], "--bogus"),
        (["info", "{tmp}/none.csv"], "none.csv"),
        (["simulate", "pendulum", "--out", "{tmp}/x.csv"], "option model = 'pendulum': choose one of dc_motor"),
        (["simulate", "dc_motor", "--out", "{motor}"], "exists already"),
        (["simulate", "dc_motor", "--out", "{tmp}/x.csv", "--duration", "0"], "give a number above 0"),
        (["simulate", "harmonic_drive", "--out", "{tmp}/x.csv", "--actuation", "current"], "needs k_t"),
        (["juggle"], "juggle"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(motor, tmp_path, run, arguments, says):
    (tmp_path / "empty.mcap").touch()
    before = {p.name for p in tmp_path.iterdir()}
    assert says in complaint(run(*[a.format(motor=motor, tmp=tmp_path) for a in arguments]))
    assert {p.name for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("samples", "says"), [(20, "too_short"), (500, "no_motion")], ids=["too short a window", "all-constant signals"]
)
def test_data_that_cannot_be_fitted_are_bad_input(tmp_path, run, samples, says):
    still = np.zeros(samples)
    recording = Recording(np.arange(samples) / 500, {"link_position": still, "torque": still})
    formats.write_csv(tmp_path / "still.csv", recording)
    code, out, err = run("fit", tmp_path / "still.csv", "--model", "rigid_joint", "--json")
    assert code == 2
    assert json.loads(out)["status"] == says
    assert err.count("\n") == 1
    assert says in err
