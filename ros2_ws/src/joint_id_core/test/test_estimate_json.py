"""Estimates that are saved come back as they were; files that hold none are refused with a reason."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import joint_id_core as jid
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


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "not a JSON file"),
        ("[1, 2]", "not an estimate"),
        ('{"format": "another"}', "not an estimate"),
        ('{"format": "joint_id estimate", "version": 99}', "of version 99.* update joint_id"),
        ('{"format": "joint_id estimate", "version": 1}', "incomplete or damaged: KeyError"),
    ],
)
def test_a_file_without_an_estimate_is_refused_with_its_name(content, says, tmp_path):
    (tmp_path / "x.json").write_text(content)
    with pytest.raises(jid.JointIdError, match=rf"x\.json: .*{says}"):
        jid.Estimate.load(tmp_path / "x.json")


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
    assert repr(fitted).startswith("<Estimate rigid_joint by innovations: converged, J=")
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


def test_a_picture_of_the_fit_is_saved(fitted, tmp_path):
    fitted.plot(tmp_path / "fit.png")
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")
    loaded = jid.Estimate.from_dict(fitted.to_dict())
    with pytest.raises(jid.JointIdError, match="holds no predictions"):
        loaded.plot(tmp_path / "again.png")
