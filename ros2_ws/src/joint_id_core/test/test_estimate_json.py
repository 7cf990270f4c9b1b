"""Estimates that are saved come back as they were; files that hold none are refused with a reason."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

import joint_id_core as jid
from joint_id_core.data.quantities import with_deviation
from joint_id_core.estimators.together.fit import together
from joint_id_core.results.estimate import Checks, ParameterEstimate

NUMBERS = st.floats(allow_infinity=False) | st.just(float("nan"))
NAMES = st.text(min_size=1, max_size=8)


@st.composite
def estimates(draw):
    names = draw(st.lists(NAMES, min_size=1, max_size=5, unique=True))
    free = tuple(draw(st.lists(st.sampled_from(names), unique=True)))
    table = {name: draw(NUMBERS) for name in draw(st.lists(NAMES, max_size=3, unique=True))}
    shape = (len(free), len(free))
    square = np.array(draw(st.lists(NUMBERS, min_size=len(free) ** 2, max_size=len(free) ** 2))).reshape(shape)
    return jid.Estimate(
        "rigid_joint", "innovations", draw(st.sampled_from(jid.Status)), draw(st.text()),
        tuple(
            ParameterEstimate(n, "Nm", draw(NUMBERS), draw(NUMBERS), draw(st.sampled_from(jid.Verdict)), draw(NUMBERS))
            for n in names
        ),
        free=free, covariance=square, nrmse=table, noise=table, chi2=draw(NUMBERS), whiteness=table,
        deviance=draw(NUMBERS), observations=7, substeps=2, iterations=3, elapsed_s=0.5, start=draw(NUMBERS),
        end=draw(NUMBERS), samples=100, notes=("a.", "b."),
        origin=draw(st.integers(0, 2**40)), source="a.csv", joint="elbow",
        model_options={"friction": "stribeck", "gravity": True}, cell="implicit",
        checks=draw(st.none() | st.just(Checks(("a", ""), np.eye(len(free)), table, {"c": "c + d"}))),
    )  # fmt: skip


@given(estimates())
def test_json_gives_every_field_back_to_the_last_bit(estimate):
    text = json.dumps(estimate.to_dict(), allow_nan=False)
    again = jid.Estimate.from_dict(json.loads(text))
    assert again == estimate
    assert json.dumps(again.to_dict(), allow_nan=False) == text


@pytest.fixture(scope="module")
def fitted():
    model = jid.build("rigid_joint", friction="stribeck")
    return jid.fit(model, jid.simulate_motion(model, 3.0))


def test_a_file_gives_the_estimate_back(fitted, tmp_path):
    fitted.save(tmp_path / "joint.json")
    again = jid.Estimate.load(tmp_path / "joint.json")
    assert again == fitted and again["J"] == fitted["J"]
    np.testing.assert_array_equal(again.covariance, fitted.covariance)
    assert jid.build(again.model, **again.model_options) == jid.build("rigid_joint", friction="stribeck")
    assert list(tmp_path.iterdir()) == [tmp_path / "joint.json"]


def test_an_estimate_can_be_validated_after_it_was_saved(fitted, tmp_path):
    model = jid.build("rigid_joint", friction="stribeck")
    fitted.save(tmp_path / "joint.json")
    other = jid.simulate_motion(model, 3.0, seed=2)
    assert jid.held_out(model, other, jid.Estimate.load(tmp_path / "joint.json")) == jid.held_out(model, other, fitted)


def test_a_recording_is_no_estimate(tmp_path):
    """The message was "Expecting value: line 1 column 1 (char 0)"."""
    path = tmp_path / "monday.csv"
    path.write_text("time_s,torque\n0,1\n")
    with pytest.raises(
        jid.JointIdError, match=r"monday.csv: not an estimate, since not a JSON file: give a file that joint-id"
    ):
        jid.Estimate.load(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", r"not a JSON file \(Expecting value"),
        ("[1, 2]", "not an estimate"),
        ('{"format": "another"}', "not an estimate"),
        ('{"format": "joint_id knowledge"}', "the state of an identifier: give a file that fit --save wrote"),
        ('{"format": "joint_id estimate", "version": 99}', "of version 99.* update joint_id"),
        ('{"format": "joint_id estimate", "version": "1"}', "\"version\" is '1', and not a whole number"),
        ('{"format": "joint_id estimate", "version": 0}', '"version" is 0, and not a whole number'),
        ("[" * 100000, "nested too deeply"),
        ('{"format": "joint_id estimate", "version": 1}', "incomplete or damaged: KeyError"),
    ],
)
def test_a_file_without_an_estimate_is_refused_with_its_name(content, says, tmp_path):
    (tmp_path / "x.json").write_text(content)
    with pytest.raises(jid.JointIdError, match=rf"x\.json: .*{says}"):
        jid.Estimate.load(tmp_path / "x.json")


def placed(content, place, value):
    """A copy of a saved estimate with another value at a place in it, such as ("parameters", 0, "unit")."""
    changed = copy.deepcopy(content)
    *way, last = place
    part = changed
    for step in way:
        part = part[step]
    part[last] = value
    return changed


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [
        (("model",), "rigid_joints", "did you mean rigid_joint"),
        (("model_options", "friction"), "stribek", "did you mean stribeck"),
        (("model_options", "wings"), 2, "options of model rigid_joint.*wings"),
        (("model_options", "friction"), 5, "options of model rigid_joint"),
        (("parameters", 0, "name"), "Q", "model rigid_joint has no parameter 'Q'"),
        (("parameters", 0, "name"), ["J"], r"name is \['J'\], and no text"),
        (("parameters", 0, "unit"), "lbf", "J is in 'lbf', and model rigid_joint has it in kg m.2"),
        (("parameters", 0, "value"), None, "value of J is nan"),
        (("parameters", 0, "value"), float("nan"), "value of J is nan"),
        (("parameters", 0, "value"), "2.2", "'2.2' is no number"),
        (("parameters", 0, "value"), -2.2, "value of J is -2.2, and must be in"),
        (("parameters", 0, "value"), 1e300, r"value of J is 1e\+300, and must be in"),
        (("parameters", -2, "value"), 1e300, r"value of tau_0 is 1e\+300, and must be in \[-10000, 10000\] Nm"),
        (("parameters", 0, "std_dev"), -1.0, "standard deviation of J, which is estimated, is -1"),
        (("parameters", 0, "std_dev"), 0.0, "standard deviation of J, which is estimated, is 0"),
        (("parameters", 0, "std_dev"), None, "standard deviation of J, which is estimated, is nan"),
        (("parameters", 0, "std_dev"), float("inf"), "standard deviation of J, which is estimated, is inf"),
        (("parameters", -1, "std_dev"), -1.0, "standard deviation of N, which is fixed, is -1"),
        (("covariance",), None, "covariance is not 6 by 6"),
        (("covariance",), [[1.0]], "covariance is not 6 by 6"),
        (("covariance", 0), [1.0], "covariance is not 6 by 6"),
        (("covariance", 0, 0), None, "number of its covariance is missing"),
        (("covariance", 0, 1), None, "number of its covariance is missing"),
        (("covariance", 0, 0), -1e-6, "variance of J is -1e-06"),
        (("free", 0), "Q", "model rigid_joint has no parameter 'Q'"),
        (("free", 0), "c", "a parameter is in it twice"),
        (("joint",), 5, "joint is 5, and no text"),
        (("origin_s",), "yesterday", "origin_s is 'yesterday', and no whole"),
    ],
)
def test_what_no_fit_can_have_made_is_refused_in_one_line(fitted, place, value, says, tmp_path):
    (tmp_path / "x.json").write_text(json.dumps(placed(fitted.to_dict(), place, value)))
    with pytest.raises(jid.JointIdError, match=rf"x\.json: .*incomplete or damaged: .*{says}") as raised:
        jid.Estimate.load(tmp_path / "x.json")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("rows", "says"), [(slice(1, None), "J is missing"), ((0, 0), "is in it twice")])
def test_every_parameter_is_there_once(fitted, rows, says, tmp_path):
    content = fitted.to_dict()
    table = content["parameters"]
    content["parameters"] = table[rows] if isinstance(rows, slice) else [table[0], *table]
    (tmp_path / "x.json").write_text(json.dumps(content))
    with pytest.raises(jid.JointIdError, match=rf"x\.json: .*incomplete or damaged: .*{says}"):
        jid.Estimate.load(tmp_path / "x.json")


def saved(estimate, path):
    estimate.save(path)
    return jid.Estimate.load(path)


def test_an_estimate_of_a_record_without_motion_is_read(tmp_path):
    """Nothing was fitted: no covariance, no standard deviation."""
    model = jid.build("rigid_joint", actuation="current")
    time = np.arange(200) / 500.0
    rest = jid.Recording(time, {"link_position": 0.0 * time, "current": 0.0 * time})
    found = jid.fit(model, rest, jid.ParameterSettings({"k_t": 0.1}))
    assert found.status.unusable and np.isnan(found["J"].std_dev)
    assert saved(found, tmp_path / "x.json") == found


@pytest.mark.parametrize(
    ("names", "std_dev", "factor", "status"),
    [
        (("c",), 1e6, 1.0, jid.Status.CONVERGED),  # this motion does not show it
        (("c",), np.nan, 0.0, jid.Status.CONVERGED),  # none of several recordings shows it
        (("J", "c", "tau_f", "dtau_s", "w_b", "tau_0"), np.nan, np.nan, jid.Status.POOR_FIT),  # a fit that failed
    ],
)
def test_what_a_motion_does_not_show_and_a_failed_fit_are_read(fitted, names, std_dev, factor, status, tmp_path):
    covariance, parameters = fitted.covariance.copy(), list(fitted.parameters)
    for name in names:
        k, row = fitted.free.index(name), list(fitted.values).index(name)
        covariance[k, :] *= factor
        covariance[:, k] *= factor
        parameters[row] = replace(parameters[row], std_dev=std_dev, verdict=jid.Verdict.NOT_EXCITED)
    found = fitted.updated(parameters=tuple(parameters), covariance=covariance, status=status)
    assert saved(found, tmp_path / "x.json") == found


def test_several_recordings_together_are_read(tmp_path):
    model = jid.build("rigid_joint")
    alone = [jid.fit(model, jid.simulate_motion(model, 3.0, seed=k)) for k in range(2)]
    found = together(model, alone).estimate
    assert "tau_0" not in found.free and found["tau_0"].verdict is jid.Verdict.ESTIMATED
    assert saved(found, tmp_path / "x.json") == found


def test_an_offset_beyond_its_prior_bounds_which_a_regression_finds_is_read(tmp_path):
    model = jid.build("rigid_joint")
    found = jid.fit(model, jid.simulate_motion(model, 3.0), estimator=jid.Regression())
    far = tuple(replace(p, value=1.5e4) if p.name == "tau_0" else p for p in found.parameters)
    far = found.updated(parameters=far)
    assert saved(far, tmp_path / "x.json") == far


def test_an_estimate_of_an_own_model_is_read_without_the_model(fitted, tmp_path):
    own = fitted.updated(model="winged")
    assert saved(own, tmp_path / "x.json") == own


def test_damage_anywhere_in_a_file_is_an_error_of_this_library(fitted):
    whole = fitted.to_dict()
    for key in whole.keys() - {"message", "elapsed_s", "source"}:
        for broken in ({k: v for k, v in whole.items() if k != key}, whole | {key: object()}):
            try:
                jid.Estimate.from_dict(broken)
            except jid.JointIdError as error:
                assert "\n" not in str(error)


def test_an_older_file_stays_where_the_new_one_cannot_be_written(fitted, tmp_path):
    with pytest.raises(jid.JointIdError, match="cannot be written"):
        fitted.save(tmp_path / "no such folder" / "joint.json")


def test_the_short_forms_say_what_was_found(fitted):
    J = fitted["J"]
    known = f"J {with_deviation(J.value, J.std_dev)}, "  # no "±1e+01" of a large value
    assert repr(fitted).startswith(f"<Estimate rigid_joint by innovations: converged, {known}")
    assert len(repr(fitted)) < 200 and "\n" not in repr(fitted)
    assert str(fitted).splitlines()[0] == "rigid_joint by innovations: converged"
    page = fitted._repr_html_()
    assert page.count("<tr>") == 1 + len(fitted.parameters) and "<b>converged</b>" in page


def test_html_escapes_what_a_message_holds(fitted):
    changed = jid.Estimate.from_dict(fitted.to_dict() | {"message": "<script>"})
    assert "<script>" not in changed._repr_html_()


def test_an_unknown_parameter_is_named(fitted):
    with pytest.raises(jid.JointIdError, match="no parameter 'k_9': it has J, c"):
        _ = fitted["k_9"]


def test_a_picture_shows_the_prediction_over_the_samples_and_its_legend_hides_nothing(fitted):
    drawn = fitted.plot()
    FigureCanvasAgg(drawn).draw()
    above, *others = drawn.axes
    measured, predicted = above.get_lines()
    assert (measured.get_label(), predicted.get_label()) == ("measured", "predicted")
    assert np.dot(to_rgb(measured.get_color()), (0.3, 0.6, 0.1)) > 0.7 and predicted.get_color() == "C3"
    assert above.get_legend().get_window_extent().y0 >= above.get_window_extent().y1
    assert not any(axis.get_legend() for axis in others)


def test_a_picture_of_the_fit_is_saved(fitted, tmp_path):
    fitted.plot(tmp_path / "fit.png")
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")
    loaded = jid.Estimate.from_dict(fitted.to_dict())
    with pytest.raises(jid.JointIdError, match="holds no predictions"):
        loaded.plot(tmp_path / "again.png")


def test_a_picture_is_written_whole_or_not_at_all(fitted, tmp_path):
    path = tmp_path / "fit.png"
    path.write_bytes(b"old")
    (tmp_path / "fit.png.part").mkdir()  # where the new one would be made
    with pytest.raises(jid.JointIdError, match=r"fit\.png: the picture cannot be written: "):
        fitted.plot(path)
    assert path.read_bytes() == b"old"
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("this computer has no /dev/full")
    (tmp_path / "full.svg").symlink_to(full)
    with pytest.raises(jid.JointIdError, match="the picture cannot be written: No space left on device: check folder"):
        fitted.plot(tmp_path / "full.svg")
