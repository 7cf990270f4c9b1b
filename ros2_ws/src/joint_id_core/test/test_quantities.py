"""How values with their standard deviations are written."""

from __future__ import annotations

import math

import pytest

from joint_id_core.data.quantities import change_text, known_digits, two_digits, unit_text, with_deviation


@pytest.mark.parametrize(
    ("value", "std_dev", "text"),
    [
        (3741.2, 752.0, "3740 ± 750"),
        (101.0, 1.0, "101.0 ± 1.0"),
        (2.8, 0.56, "2.80 ± 0.56"),
        (-17.96, 1.3, "-18.0 ± 1.3"),
        (0.06988, 0.0664, "0.070 ± 0.066"),
        (4.6, 100.0, "4.6 ± 100"),
        (0.0, 0.02, "0.000 ± 0.020"),
        (9.98, 0.0996, "9.98 ± 0.10"),
        (49.9642, 0.05, "49.964 ± 0.050"),
        (1.2, 1.2e-9, "1.2000000000 ± 1.2e-09"),
        (5.9909e-05, 9.5e-08, "5.9909e-05 ± 9.5e-08"),
        (9.0088e8, 3.2e6, "9.009e+08 ± 3.2e+06"),
        (1.0, float("nan"), "1 ± nan"),
    ],
)
def test_a_value_has_the_digits_of_its_standard_deviation(value, std_dev, text):
    assert with_deviation(value, std_dev) == text


@pytest.mark.parametrize(
    ("value", "std_dev", "text"),
    [(1.99091, 1.9, "2.0"), (0.087139, 0.25, "0.087"), (5155.18, 10.0, "5155"), (0.106, math.nan, "0.106")],
)
def test_a_value_alone_has_the_same_digits(value, std_dev, text):
    assert known_digits(value, std_dev) == text


def test_a_ratio_has_no_unit():
    assert (unit_text("1"), unit_text("Nm")) == ("", "Nm")
    assert change_text(4.7, 0.42, "%") == "+4.70 ± 0.42 %" and change_text(-0.5, 0.02) == "-0.500 ± 0.020"
    assert with_deviation(101.0, 2.5, "1") == "101.0 ± 2.5" and with_deviation(101.0, 2.5, "Nm") == "101.0 ± 2.5 Nm"


def test_two_digits_need_no_exponent_near_one():
    assert [two_digits(v) for v in (1340.0, 0.5, 0.00052, 2.9e4, 9.5e-8, 3.2e6)] == [
        "1300", "0.5", "0.00052", "29000", "9.5e-08", "3.2e+06",
    ]  # fmt: skip
