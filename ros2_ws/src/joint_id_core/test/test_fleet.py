"""A joint that is not like those of the other robots is found, and chance is not taken for one."""

from __future__ import annotations

import json

import numpy as np
import pytest

from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import row_of_failure, with_provenance
from joint_id_core.batch.store import store
from joint_id_core.batch.table import join, write_part
from joint_id_core.results.fleet import FALSE_ALARMS, apart, limit, of_others
from joint_id_core.results.history import DAY_S, Known, courses

from .quick import first_quick


def fleet(values, sigmas, times=1, rng=None):
    """A parameter of one joint, of a robot a value, with as many estimates as `times`."""
    rows = []
    for k, (value, sigma) in enumerate(zip(values, sigmas, strict=True)):
        for day in range(times):
            seen = value if rng is None else value + sigma * rng.standard_normal()
            rows.append(Known(f"ur_{k}", "elbow", "rigid_joint", "c", "Nm s/rad", day * DAY_S, seen, sigma))
    return courses(rows)


@pytest.mark.parametrize(
    ("robots", "sigma"), first_quick([(6, 0.0), (20, 5.0), (7, 0.0), (10, 0.0), (20, 0.0), (10, 1.0)])
)
def test_a_fleet_without_an_outlier_has_one_in_a_hundred_times(robots, sigma):
    """Robots differ by one unit, and are known to 0.001 to 5; the largest share allowed is three sigma of the count."""
    rng, count = np.random.default_rng(robots), 2500
    alarms = 0
    for k in range(count):
        sigmas = np.maximum(sigma * rng.uniform(0.3, 1.7, robots), 1e-3)
        values = 10.0 + rng.standard_normal(robots) + sigmas * rng.standard_normal(robots)
        centres, spreads = of_others(values)
        alarm = bool((abs(values - centres) > limit(robots) * np.hypot(sigmas, spreads)).any())
        assert k > 50 or alarm == bool(apart(fleet(values, sigmas)))
        alarms += alarm
    assert alarms <= count * FALSE_ALARMS + 3.0 * np.sqrt(count * FALSE_ALARMS)


@pytest.mark.parametrize(("robots", "off"), [(10, 20.0), (20, 9.0), (40, 7.0)])
def test_a_joint_that_lies_apart_is_found_also_beside_another_one(robots, off):
    rng, found = np.random.default_rng(1), 0
    for _ in range(60):
        values = 10.0 + rng.standard_normal(robots)
        values[3] += off
        values[5] -= 3.0 * off  # hides the first one from a mean and a standard deviation
        found += {"ur_3", "ur_5"} <= {a.robot for a in apart(fleet(values, np.full(robots, 0.1)))}
    assert found > 50


def test_a_value_that_is_not_well_known_does_not_lie_apart():
    values, sigmas = np.r_[np.linspace(9.9, 10.1, 11), 20.0], np.full(12, 0.01)
    assert [a.robot for a in apart(fleet(values, sigmas))] == ["ur_11"]
    sigmas[-1] = 5.0
    assert apart(fleet(values, sigmas)) == []


def test_several_estimates_of_a_robot_are_one_value_with_their_scatter():
    rng = np.random.default_rng(0)
    values = np.r_[np.linspace(9.9, 10.1, 11), 11.5]
    (one,) = apart(fleet(values, np.full(12, 0.1), 25, rng))
    assert one.value == pytest.approx(11.5, abs=0.1) and one.std_dev == pytest.approx(0.02, rel=0.5)
    assert one.others == 11 and one.text.startswith("ur_11: elbow, c is 11.")


def test_few_robots_and_robots_without_a_name_are_not_compared():
    values, sigmas = [10.0, 10.1, 9.9, 10.0, 99.0], [0.01] * 5
    assert apart(fleet(values, sigmas)) == []
    nameless = [c.__class__(**{**c.__dict__, "robot": ""}) for c in fleet([*values, *values], sigmas * 2)]
    assert apart(nameless) == []


def test_the_limits_are_those_of_the_page():
    assert [limit(n) for n in (6, 10, 20)] == pytest.approx([35, 12, 6.4], rel=0.05)


def test_history_reads_the_table_of_a_batch(tmp_path, run):
    """Twelve robots on four days; the joint of one wears, and another one is far from all."""
    place, parts, rng = store(str(tmp_path / "out.parquet")), {}, np.random.default_rng(0)
    for robot in range(12):
        for day in range(4):
            one = Found(f"/logs/ur_{robot:02}/{day}.mcap", 1, "now")
            c = 10.0 + 0.1 * rng.standard_normal() + (robot == 3) * day + 40.0 * (robot == 7)
            parameter = {
                "name": "c",
                "unit": "Nm s/rad",
                "value": c,
                "std_dev": 0.1,
                "verdict": "estimated",
                "reason": "",
            }
            row = row_of_failure("converged", "") | {"model": "rigid_joint", "parameters": [parameter]}
            row |= {"end_s": 1.7e9 + day * DAY_S}
            rows = [with_provenance(row, one, "elbow", f"ur_{robot:02}", [], "{}")]
            parts[one.place] = None
            with place.locked():
                parts[one.place] = write_part(place, rows, one)
    bad = Found("/logs/bad.mcap", 1, "now")
    with place.locked():
        rows = [with_provenance(row_of_failure("error", "cut"), bad, "", "", [], "{}")]
        parts[bad.place] = write_part(place, rows, bad)
        join(place, parts)
    code, out, err = run("history", tmp_path / "out.parquet", "--json")
    told = json.loads(out)
    assert code == 0 and "1 of 49 rows" in err
    trends = {c["robot"]: c["trend"] for c in told["courses"]}
    assert [r for r, t in trends.items() if "a trend" in t] == ["ur_03"] and told["courses"][0]["days"] == [0, 1, 2, 3]
    assert [(a["robot"], a["joint"], a["name"], a["others"]) for a in told["apart"]] == [("ur_07", "elbow", "c", 11)]
    code, out, _ = run("history", tmp_path / "out.parquet")
    assert code == 0 and "ur_03 elbow" in out and "unlike the others: ur_07: elbow, c is 49.964 ± 0.050 " in out


def test_what_is_no_table_is_said(tmp_path, run):
    code, _, err = run("history", tmp_path / "none.parquet")
    assert code == 2 and "no such folder or table" in err
    (tmp_path / "half.parquet").write_bytes(b"PAR1")
    code, _, err = run("history", tmp_path / "half.parquet")
    assert code == 2 and "damaged or half-written" in err and (tmp_path / "half.parquet").read_bytes() == b"PAR1"
