"""The benchmark of real recordings: how it counts, and that it finds published values where the data are there."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from robots import live, methods, stiffness, whole_arm, wrong_model
from robots.cases import CASES, Known
from robots.fitted import Fitted, Value, of_json
from robots.judging import Pairs, farthest, held_out, pairs, relative_sigma, usable
from robots.pages import joints_table, methods_table, stiffness_table, targets_table
from robots.plain import plain_least_squares
from robots.recordings import DATA, UR10E_ALL, kuka
from robots.targets import stiffness_verdicts, verdicts

from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.data.recording import Recording

with_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured data are not there: {DATA}")
ALONE, TOGETHER = CASES[0], CASES[3]


def fit(c: float, tau_f: float = 5.0, status: str = "converged", verdict: str = "estimated", **changes) -> Fitted:
    """A fit of joint 4 whose values have a standard deviation of 0.1."""
    values = {"J": Value(0.5, 0.1), "c": Value(c, 0.1, verdict), "tau_f": Value(tau_f, 0.1)}
    whole = Fitted(ALONE.name, "joint 4", "log", methods.REGRESSION, status, "", 0.03, values)
    return replace(whole, **changes)


def test_a_fit_is_usable_if_both_frictions_are_estimated_and_the_model_describes_the_motion():
    fits = [fit(1.0), fit(1.0, status="disagree"), fit(1.0, status="poor_fit"), fit(1.0, verdict="prior")]
    assert [f.usable for f in fits] == [True, True, False, False]
    assert usable(fits) == (2, 4)
    assert [f.good for f in fits] == [True, False, False, True]


def test_pairs_agree_within_95_percent_of_their_difference():
    wide = 1.96 * np.hypot(0.1, 0.1)
    assert pairs([fit(1.0), fit(1.0 + 0.99 * wide)], ("c",)) == Pairs(1, 1)
    assert pairs([fit(1.0), fit(1.0 + 1.01 * wide)], ("c",)) == Pairs(0, 1)
    three = [fit(1.0), fit(1.1), fit(9.0)]
    assert pairs(three) == Pairs(1 + 3, 3 + 3)
    assert pairs(three).share == pytest.approx(4 / 6)
    assert np.isnan(pairs([fit(1.0)]).share)


def test_only_usable_fits_of_one_joint_make_pairs():
    other = fit(9.0, joint="joint 1")
    assert pairs([fit(1.0), other]) == Pairs(0, 0)
    assert pairs([fit(1.0), fit(9.0, status="poor_fit")]) == Pairs(0, 0)
    unknown = [fit(1.0, verdict="prior"), fit(9.0, verdict="prior")]
    assert pairs(unknown) == Pairs(0, 0)
    assert pairs(unknown, ("J",), friction=False) == Pairs(1, 1)  # inertia may be known where friction is not


def test_medians_are_of_usable_fits():
    fits = [fit(1.0, held_out=(0.9, 0.8)), fit(2.0, held_out=(0.99,)), fit(1e-3, status="poor_fit")]
    assert relative_sigma(fits) == pytest.approx(np.median([0.1, 0.05, 0.02, 0.02]))
    assert held_out(fits) == (0.9, 0.8)
    assert np.isnan(relative_sigma(fits[2:])) and np.isnan(held_out(fits[2:])[0])


def test_the_farthest_value_counts_the_spread_of_its_reference():
    known = {(ALONE.name, "joint 4"): {"c": Known(2.0, 0.0), "tau_f": Known(4.0, 10.0)}}
    worst = farthest([fit(1.0), fit(1.9)], known, ("c", "tau_f"))
    assert (worst.name, worst.sigmas, worst.share) == ("c", pytest.approx(-10.0), pytest.approx(-0.5))
    careful = [fit(1.0, status="disagree"), fit(1.9)]
    assert farthest(careful, known, ("c", "tau_f"), good=True).sigmas == pytest.approx(-1.0)
    assert farthest([], known, ("c",)).fit is None


def test_targets_are_met_or_missed():
    good = [fit(3.6, 2.8), fit(3.7, 2.9)]
    said = [text for _, text in verdicts(good)]
    assert said[0].endswith("1.00 (2 of 2): **missed**")  # wider than honest
    assert [text.endswith(": met") for text in said[1:]] == [True] * 4
    worst = verdicts([*good, fit(7.0, 2.8)])[4][1]
    assert worst.startswith("+15 (`c`, joint 4") and worst.endswith("**missed**")
    assert verdicts([]) == [] and stiffness_verdicts([]) == []


def axis(number: int, k_1: float, status: str = "converged", run: str = stiffness.BOTH) -> stiffness.Stiffness:
    values = {"k_1": Value(k_1, 0.1e6)}
    return stiffness.Stiffness(stiffness.DOCUMENTED, methods.REGRESSION, number, run, status, "", 0.1, values)


def test_a_stiffness_that_is_called_good_must_be_near():
    fits = [axis(1, 3e6), axis(2, 7e6), axis(2, 2e6, "poor_fit", "A"), axis(3, 1e6)]
    said = [text for _, text in stiffness_verdicts(fits)]
    assert said[0].startswith("1 of 1 fits call it estimated") and said[0].endswith("**missed**")
    assert said[1].startswith("7 ± 0.1e6 (-7 %, `converged`)") and said[1].endswith(": met")
    assert said[2].startswith("1 ± 0.1e6 (-76 %") and said[2].endswith("**missed**")
    assert "`k_1` of axis 3, -31; 2 of 2" in said[3]


def test_fits_outlive_a_file_of_them():
    one = fit(1.0, held_out=(0.9,))
    assert of_json(json.loads(json.dumps(asdict(one)))) == one


def test_tables_have_a_row_for_what_is_not_there(monkeypatch, tmp_path: Path):
    monkeypatch.setattr("robots.cases.DATA", tmp_path)
    monkeypatch.setattr("robots.stiffness.DATA", tmp_path)
    lines = methods_table([]).splitlines()
    assert len(lines) == 2 + len(CASES)
    assert all("is not there" in line for line in lines[2:])
    assert "kuka_kr300` is not there" in stiffness_table([])
    assert {line.count("|") for line in lines} == {lines[0].count("|")}


def test_tables_have_as_many_cells_as_columns():
    fits = [fit(c, case=case.name, method=m) for c in (3.6, 3.7) for case in (ALONE, TOGETHER) for m in methods.METHODS]
    axes = [axis(2, 7e6), axis(1, 3e6)]
    for text in (methods_table(fits), joints_table(fits), stiffness_table(axes), targets_table(fits, axes)):
        lines = text.splitlines()
        assert len(lines) > 2
        assert {line.count("|") for line in lines} == {lines[0].count("|")}, text


def test_plain_least_squares_finds_a_simulated_joint():
    time = 0.01 * np.arange(4000)
    q = np.sin(1.3 * time) + 0.3 * np.sin(3.1 * time)
    w = 1.3 * np.cos(1.3 * time) + 0.93 * np.cos(3.1 * time)
    a = -1.69 * np.sin(1.3 * time) - 2.883 * np.sin(3.1 * time)
    load = 2.0 * np.cos(q) - 3.0 * np.sin(q)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(time))
    torque = 0.5 * a + 3.0 * w + 2.0 * np.sign(w) + 0.4 + load + noise
    truth = {"J": 0.5, "c": 3.0, "tau_f": 2.0, "tau_0": 0.4, "a_g": 2.0, "b_g": -3.0}
    values, sigma = plain_least_squares(Recording(time, {"link_position": q, "torque": torque}), True)
    assert values == pytest.approx(truth, rel=0.02) and set(sigma) == set(truth)
    channels = {"link_position": q, "torque": torque, "external_torque": load}
    known = plain_least_squares(Recording(time, channels), False)[0]
    assert known == pytest.approx({n: truth[n] for n in known}, rel=0.02)


@with_data
def test_emps_has_the_published_values_and_predicts_the_run_with_pulses():
    (case,) = (c for c in CASES if c.folder == "emps")
    known = case.joints[0].known
    for f in methods.fits(case, (methods.REGRESSION, methods.PLAIN)):
        assert f.usable, str(f)
        assert {n: f.values[n].value / k.value for n, k in known.items()} == pytest.approx(
            dict.fromkeys(known, 1.0), 0.03
        )
        assert len(f.held_out) == 1 and f.held_out[0] > 0.99


@with_data
def test_both_encoders_of_an_axis_have_the_same_motion():
    ratio, recording = kuka("A", 2)
    twist = recording["motor_position"] / ratio - recording["link_position"]
    assert np.ptp(recording["link_position"]) > 0.4 and np.abs(twist).max() < 2e-3


@with_data
@pytest.mark.long
def test_every_joint_of_every_case_is_recorded():
    for case in CASES:
        for joint in case.joints:
            recordings = joint.fitted()
            assert min(r.duration for r in recordings) > 10.0
            assert all({"link_position", "torque"} <= set(r.channels) for r in (*recordings, *joint.only_predicted()))


@with_data
def test_links_of_an_arm_are_plausible_and_its_files_predict_as_the_fit_does():
    description = Description.read(whole_arm.URDF)
    gains = {name: {"torque": 1.0} for name in description.joints}
    first, _, other = (whole_arm.record(name, description.joints) for name in UR10E_ALL)
    found = fit_arm(description, [first], gains, other)
    for link in found.links.links:
        assert 0.7 < link.found.mass / link.described.mass < 1.4 and link.rotor > 0.0
    assert found.links.off < 1.5 and not found.links.doubts
    mjcf, urdf = whole_arm.by_files(description, found, other)
    for joint, whole, without_rotor in zip(found.joints, mjcf, urdf, strict=True):
        assert whole > joint.held_out - 0.005 and without_rotor < whole + 1e-9  # a URDF has the first rotor, too


def test_the_longest_stretch_of_wrong_estimates_lasts_until_the_next_right_one():
    ends = [1.0, 1.5, 2.0, 2.5, 3.0]
    assert live.longest([False] * 5, ends) == 0.0
    assert live.longest([True, False, True, True, False], ends) == 1.0
    assert live.longest([False, False, False, True, True], ends) == 0.5
    assert live.longest([], []) == 0.0


def test_a_row_of_the_live_table_is_the_sum_of_its_recordings():
    one = live.Live(ALONE.name, "joint 1", "log", 40, 20, 10, 1, 0.5, 40, 38, 0, 3, 0.05, 0.1)
    rows = live.live_table(
        [one, replace(one, known=0, good=0, wrong=0, compared=0, inside=0, sigma=np.nan)]
    ).splitlines()
    assert len(rows) == 4
    assert rows[2] == f"| {ALONE.name} | 2 | 80 | 25 % | 12 % | 10 % | 0.5 s | 95 % | 0 % | 6 | 5 % | 10 % |"
    assert rows[3] == rows[2].replace(ALONE.name, "**all**")


@pytest.mark.long
@with_data
def test_live_friction_of_a_real_joint_is_known_and_right():
    """Of the recursion alone, friction of this joint was known at a tenth of the estimates."""
    joint = ALONE.joints[1]
    rows = [live.follow(ALONE, joint, recording) for recording in joint.fitted()]
    assert sum(r.known for r in rows) > 0.4 * sum(r.moved for r in rows)
    assert sum(r.inside for r in rows) > 0.85 * sum(r.compared for r in rows)
    assert sum(r.far for r in rows) == 0 and max(r.longest_s for r in rows) <= 2.0


@pytest.mark.long
@with_data
def test_a_wrong_model_takes_a_few_times_what_a_good_fit_of_a_recording_takes():
    """It took 30 times as long, for an axis whose stiffness the motion does not show."""
    (row,) = wrong_model.rows([case for case in wrong_model.CASES if case.name == "KUKA, axis 1"])
    assert (row.good_status, row.wrong_status) == ("converged", "poor_fit")
    assert row.ratio < wrong_model.MOST
