"""Texts NAME=VALUE of command lines and ROS parameters."""

from __future__ import annotations

import pytest

from joint_id_core.assignments import measured_by_name, numbers_by_name, texts_by_name
from joint_id_core.errors import JointIdError


def test_they_are_read_by_name():
    assert numbers_by_name(["N=101", " k_t = 0.1 "], "--set") == {"N": 101.0, "k_t": 0.1}
    assert texts_by_name(["torque=gtau*vir", "time_s=t"], "--map") == {"torque": "gtau*vir", "time_s": "t"}


@pytest.mark.parametrize("bad", ["N", "N=", "=3", "", "N=x"])
def test_another_form_is_refused_with_the_name_of_the_option(bad):
    with pytest.raises(JointIdError, match=f"parameter set {bad}"):
        numbers_by_name([bad], "parameter set")


def test_a_name_is_given_once():
    with pytest.raises(JointIdError, match="--set N is given twice"):
        numbers_by_name(["N=1", "N=2"], "--set")


def test_a_value_may_have_a_standard_deviation():
    values, deviations = measured_by_name(["k_t=0.1+-20%", "N = 101", "c=-2 +- 0.5", "d=-4+-10 %"], "--set")
    assert values == {"k_t": 0.1, "N": 101.0, "c": -2.0, "d": -4.0}
    assert deviations == pytest.approx({"k_t": 0.02, "c": 0.5, "d": 0.4})


@pytest.mark.parametrize(
    "bad", ["k_t=0.1+-", "k_t=+-1", "k_t=1+-0", "k_t=1+--1", "k_t=1+-nan", "k_t=1+-x", "k_t=0+-10%"]
)
def test_a_standard_deviation_of_another_form_is_refused(bad):
    with pytest.raises(JointIdError, match="is not a number"):
        measured_by_name([bad], "--set")
