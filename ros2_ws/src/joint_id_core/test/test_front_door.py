"""What `import joint_id_core as jid` gives: few names, loaded when they are used."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version

import pytest

import joint_id_core as jid
from joint_id_core.data.quantities import with_deviation

MODEL = jid.build("rigid_joint")
MOTION = jid.simulate_motion(MODEL, 3.0)
NAMES = (
    "Description", "Estimate", "HPinn", "Innovations", "JointIdError", "Model", "OnlineIdentifier", "OnlineOptions",
    "ParameterSettings", "Recording", "Regression", "Status", "Verdict", "bootstrap", "build", "compare",
    "design_arm", "design_joint", "fit", "fit_arm", "fit_fleet", "fit_several", "held_out", "loaded", "many_starts",
    "read", "read_limits", "simulate", "simulate_motion", "train_many", "write",
)  # fmt: skip


def test_the_public_names_are_these_and_all_of_them_load():
    assert tuple(dir(jid)) == tuple(jid.__all__) == NAMES
    assert all(callable(getattr(jid, name)) for name in NAMES)


def test_an_unknown_name_says_what_there_is():
    with pytest.raises(AttributeError, match="no attribute 'Fit': it has Description"):
        _ = jid.Fit


def test_the_import_loads_no_other_library():
    code = "import sys, joint_id_core; print(*sorted({m.partition('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert not {"numpy", "scipy", "sympy", "numba", "torch", "typer", "matplotlib"} & set(done.stdout.split())


@pytest.fixture(scope="module")
def recording():
    return jid.simulate_motion(jid.build("rigid_joint"), 3.0, seed=1)


@pytest.fixture(scope="module")
def estimate():
    return jid.fit(MODEL, MOTION)


def test_a_recording_comes_back_from_a_file(recording, tmp_path):
    for name in ("motion.csv", "bag"):
        jid.write(tmp_path / name, recording)
        again = jid.read(tmp_path / name)
        assert set(again.channels) == set(recording.channels)
        assert len(again) == len(recording)


def test_models_are_compared_by_text_or_as_objects(recording):
    own = jid.build("rigid_joint", friction="stribeck")
    found = jid.compare(["rigid_joint:coulomb_viscous", own], recording)
    labels = {row.trial.label for row in found.ranking.rows}
    assert labels == {"rigid_joint:coulomb_viscous", "rigid_joint:stribeck+torque"}
    assert "rigid_joint:stribeck" in str(found) and found.to_dict()["best"] in labels


@pytest.mark.parametrize(("duration", "rate"), [(0.0, 500.0), (1.0, -1.0), (float("nan"), 500.0)])
def test_a_motion_needs_a_length_and_a_rate(duration, rate):
    with pytest.raises(jid.JointIdError, match="give a number above 0"):
        jid.simulate_motion(jid.build("rigid_joint"), duration, rate)


def test_the_true_values_of_a_simulated_motion_are_found(recording):
    estimate = jid.fit(jid.build("rigid_joint"), recording, jid.ParameterSettings({"J": 2.0}))
    assert estimate.converged
    assert abs(estimate["J"].value - 1.0) < 4.0 * estimate["J"].std_dev
    assert set(jid.held_out(jid.build("rigid_joint"), recording, estimate)) == {"link_position"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("rigid_joint", MOTION), r"model is 'rigid_joint', of type str: make it with build"),
        ((MODEL, "log.csv"), r"recording is 'log.csv', of type str: make it with read"),
        ((MODEL, [MOTION, None]), "recording is None, of type NoneType"),
        ((MODEL, MOTION, {"J": 2.0}), "settings is .* of type dict: make it with ParameterSettings"),
        ((MODEL, MOTION, None, "regression"), "estimator is 'regression', of type str: make it with Regression"),
    ],
)
def test_an_argument_of_another_type_is_named(arguments, said):
    with pytest.raises(jid.JointIdError, match=said):
        jid.fit(*arguments)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda found: jid.simulate_motion("rigid_joint", 1),
            "model is 'rigid_joint', of type str: make it with build",
        ),
        (lambda found: jid.simulate("rigid_joint", [0, 1], {}), "model is 'rigid_joint', of type str"),
        (lambda found: jid.held_out(MODEL, found, MOTION), "recording is .*, of type Estimate: make it with read"),
        (lambda found: jid.held_out(MODEL, MOTION, {}), "estimate is {}, of type dict: make it with fit"),
        (lambda found: jid.compare("rigid_joint", MOTION), r"models is 'rigid_joint', of type str: give a list of"),
        (lambda found: jid.write(MOTION, "log.csv"), "path is .*, of type Recording: give the name of a file"),
        (lambda found: jid.write("log.csv", found), "recording is .*, of type Estimate: make it with read"),
        (lambda found: jid.simulate_motion(MODEL, "3"), "duration is '3', of type str: give a number above 0"),
        (lambda found: jid.ParameterSettings({"J": "2"}), "values: J is '2', of type str: give a number"),
        (lambda found: jid.ParameterSettings(priors={"J": None}), "priors: J is None, of type NoneType: give a number"),
        (lambda found: jid.ParameterSettings(3), "values is 3, of type int: give a dictionary, such as values={"),
        (lambda found: jid.ParameterSettings(fixed=3), r"fixed is 3, of type int: give a list of names, such as"),
        (lambda found: jid.fit_several(MODEL, MOTION), r"recordings is Recording.* of type Recording: give a list"),
        (lambda found: jid.fit_several(MODEL, [MOTION, 3]), "recording is 3, of type int: make it with read"),
        (lambda found: jid.read(3), "path is 3, of type int: give the name of a file"),
        (lambda found: found.save(None), "path is None, of type NoneType: give the name of a file"),
        (lambda found: found.plot(3), "path is 3, of type int: give the name of a file"),
        (lambda found: jid.Estimate.load(None), "path is None, of type NoneType: give the name of a file"),
        (lambda found: jid.read("log.csv", mapping={"torque": 5}), "mapping of torque is 5, of type int: give a"),
        (lambda found: jid.read("log.csv", joint=5), "joint is 5, of type int: give the name of a joint"),
        (lambda found: jid.Recording(MOTION.time, {}, joint=5), "joint is 5, of type int: give the name of a joint"),
        (lambda found: jid.Innovations(substeps="2"), "option substeps = '2': give a whole number"),
        (lambda found: jid.HPinn(epochs=2.5), "option epochs = 2.5: give a whole number"),
        (lambda found: jid.Regression(band_hz=None), "option band_hz = None: give a number"),
        (lambda found: jid.read("log.csv", mapping=["a"]), r"mapping is \['a'\], of type list: give a dictionary"),
        (lambda found: jid.build(3), "unknown model 3: choose one of dc_motor"),
        (lambda found: found[0], "model rigid_joint has no parameter 0: it has J, c"),
    ],
)
def test_an_argument_of_another_type_is_named_elsewhere(call, said, estimate):
    with pytest.raises(jid.JointIdError, match=said):
        call(estimate)


def test_an_estimate_is_read_like_a_mapping(estimate):
    assert "J" in estimate and "k_1" not in estimate
    assert list(estimate) == list(estimate.values) and len(estimate) == len(estimate.parameters)


def test_a_status_and_a_verdict_are_texts(estimate):
    assert estimate.status == "converged" and estimate["J"].verdict == "estimated"
    assert f"{estimate.status}, {estimate['J'].verdict}" == "converged, estimated"
    assert {jid.Status.CONVERGED: 1}["converged"] == {"estimated": 1}[jid.Verdict.ESTIMATED] == 1


def test_the_version_is_that_of_the_package():
    assert jid.__version__ == version("joint-id-core")


def test_an_estimate_is_a_frame_and_a_figure(estimate, monkeypatch):
    found = estimate
    frame = found.to_frame()
    assert list(frame.index) == [p.name for p in found.parameters] and frame.loc["J", "value"] == found["J"].value
    drawn = found.plot()
    labels = [axis.get_ylabel() for axis in drawn.axes]
    assert labels == ["link position [rad]", "predicted -\nmeasured", "input\ntorque [Nm]", ""]
    cells = [cell.get_text().get_text() for cell in drawn.axes[-1].tables[0].get_celld().values()]
    inertia = with_deviation(found["J"].value, found["J"].std_dev).split(" ± ")
    assert {"J", "c", "tau_f", "estimated", inertia[0], f"± {inertia[1]}"} <= set(cells)
    assert "begin anew" in drawn.axes[1].get_title()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(jid.JointIdError, match="pip install pandas"):
        found.to_frame()
