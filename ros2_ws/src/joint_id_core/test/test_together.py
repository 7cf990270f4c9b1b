"""Several recordings of one joint in one estimate."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit, fit_several
from joint_id_core.estimators.together.fit import together
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

MODEL = build("rigid_joint")
TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0}
RATE = 250


def record(seed: int, offset: float = 0.0, seconds: float = 6.0, **changed: float) -> Recording:
    """A stretch of its own motion, noise and offset of the torque."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    torque = multisine(time, 20.0, tuple(rng.uniform(0.3, 4.0, 4)), seed=seed)
    pushed = torque + 0.3 * rng.standard_normal(len(time))
    moved = simulate(MODEL, time, {"torque": pushed}, {**TRUTH, **changed, "tau_0": offset})
    seen = Sensors(noise={"link_position": 2e-5}).measure(moved, seed, keep=("link_position",))
    named = seen.with_channels({"torque": torque})
    return Recording(named.time, named.channels, source=f"part {seed}", joint="elbow")


PARTS = [record(seed, offset) for seed, offset in ((1, 0.5), (2, -0.8), (3, 0.1), (4, 1.2))]


@pytest.mark.parametrize("estimator", first_quick([Innovations(), Regression()]))
def test_all_recordings_tell_more_than_one_and_keep_their_own_offsets(estimator):
    found = fit_several(MODEL, PARTS, estimator=estimator)
    assert found.estimate.converged and len(found.alone) == 4
    for name, truth in TRUTH.items():
        row = found.estimate[name]
        assert row.verdict is Verdict.ESTIMATED and abs(row.value - truth) < 4.0 * row.std_dev
        assert row.std_dev < 0.8 * np.median([one[name].std_dev for one in found.alone])
    assert found.estimate.free == ("J", "c", "tau_f")  # what is common
    assert found.estimate["tau_0"].reason.startswith("one a recording: ")
    assert [one["tau_0"].value for one in found.alone] == pytest.approx([0.5, -0.8, 0.1, 1.2], abs=0.1)
    assert found.estimate.source == "part 1, part 2, part 3, part 4"
    assert found.estimate.values == fit(MODEL, PARTS, estimator=estimator).values


def test_the_sum_is_the_product_of_the_likelihoods():
    """With diagonal covariances and a wide prior: means weighted by the inverse of the variance."""
    found = fit_several(MODEL, PARTS[:2])
    for name in TRUTH:
        logs = [(np.log(one[name].value), one[name].std_dev / one[name].value) for one in found.alone]
        weights = np.array([sigma**-2 for _, sigma in logs])
        # correlations between the parameters make it an approximation
        mean = float(np.exp(np.sum(weights * [value for value, _ in logs]) / np.sum(weights)))
        assert found.estimate[name].value == pytest.approx(mean, rel=0.01)


@pytest.mark.long
def test_intervals_hold_the_truth_over_many_sets():
    inside = []
    for k in range(12):
        parts = [record(100 + 3 * k + j, 0.3 * j, seconds=4.0) for j in range(3)]
        found = fit_several(MODEL, parts, estimator=Innovations()).estimate
        inside += [abs(found[n].value - truth) < 1.96 * found[n].std_dev for n, truth in TRUTH.items()]
    assert np.mean(inside) > 0.85


def assert_holds(found, name):
    """The interval of a parameter contains the value of every recording."""
    row = found.estimate[name]
    for one in found.alone:
        assert abs(one[name].value - row.value) <= 1.96 * row.std_dev, one.source


def test_a_recording_that_differs_is_said_and_the_interval_contains_the_scatter():
    found = fit_several(MODEL, [*PARTS[:3], record(5, c=4.5)])
    assert found.estimate.status is Status.DISAGREE
    low, high = re.search(r"c is (.*) \(part [123]\) to (.*) \(part 5\)", found.estimate.message).groups()
    assert [float(text.split()[0]) for text in (low, high)] == pytest.approx([3.0, 4.5], abs=0.1)
    assert abs(found.apart[3]["c"]) > 3.0
    assert found.estimate["c"].std_dev > 0.2
    assert_holds(found, "c")
    lines = str(found).splitlines()[-4:]
    assert [line.strip().partition(":")[0] for line in lines] == ["part 1", "part 2", "part 3", "part 5"]


def turned(value: float, other: float, slope: float) -> Estimate:
    """What a recording says of J and b_g that knows one combination of them a hundred times as well as each."""
    one = fit(build("rigid_joint", gravity=True), PARTS[0], estimator=Regression())
    along, across = np.array([1.0, slope]) / math.hypot(1.0, slope), np.array([-slope, 1.0]) / math.hypot(1.0, slope)
    both = 0.09 * np.outer(along, along) + 9e-6 * np.outer(across, across)
    at = [one.free.index("J"), one.free.index("b_g")]
    covariance = np.diag(np.diag(one.covariance))
    covariance[np.ix_(at, at)] = both
    changed = {"J": (value, math.sqrt(both[0, 0])), "b_g": (other, math.sqrt(both[1, 1]))}
    rows = tuple(
        replace(p, value=changed[p.name][0], std_dev=changed[p.name][1], verdict=Verdict.ESTIMATED)
        if p.name in changed else p
        for p in one.parameters
    )  # fmt: skip
    return replace(one, parameters=rows, covariance=covariance, status=Status.CONVERGED, checks=None)


def test_where_correlated_parameters_disagree_the_interval_holds_every_recording():
    """Two lines that are nearly parallel cross far from both recordings: the sum of their information is there, at 2.1.

    What holds lies between the recordings.
    """
    found = together(build("rigid_joint", gravity=True), [turned(0.8, -0.2, -1.0), turned(0.6, 0.3, -1.1)])
    assert 0.6 <= found.estimate["J"].value <= 0.8 and found.estimate.status is Status.DISAGREE
    assert 0.1 < found.estimate["J"].std_dev < 0.3 and abs(found.apart[0]["J"]) > 3.0
    assert_holds(found, "J")
    assert_holds(found, "b_g")


def test_what_no_recording_shows_is_not_excited_once():
    """A torque constant and an inertia that only scale together, with a wide prior: no recording tells them apart."""
    model = build("rigid_joint", gravity=True)
    small = [one.with_channels({"link_position": one["link_position"]}) for one in PARTS]
    held = ParameterSettings(priors={"a_g": 1e-3, "b_g": 1e-3})
    found = fit_several(model, small, held)
    for name in ("a_g", "b_g"):
        assert found.estimate[name].verdict is Verdict.NOT_EXCITED
        assert found.estimate[name].std_dev == pytest.approx(1e-3, rel=0.1)  # the prior counts once


def test_a_recording_that_cannot_be_used_is_left_out_and_named():
    still = PARTS[0].with_channels({"link_position": np.zeros(len(PARTS[0]))})
    still = Recording(still.time, still.channels, source="standing")
    found = fit_several(MODEL, [still, *PARTS[1:]])
    assert found.estimate.converged and found.alone[0].status is Status.NO_MOTION
    assert any("Left out: standing (no_motion" in note for note in found.estimate.notes)
    assert fit(MODEL, [still, still]).status is Status.NO_MOTION


def test_a_recording_that_is_in_doubt_by_itself_is_named():
    alone = fit_several(MODEL, PARTS[:2]).alone
    doubted = replace(alone[1], status=Status.DISAGREE, message="J is 1 by one and 2 by another.")
    found = together(MODEL, [alone[0], doubted]).estimate
    assert found.status is Status.DISAGREE
    assert found.message.startswith("Recording part 2: J is 1 by one and 2 by another.")


def test_one_recording_is_that_recording():
    assert fit(MODEL, PARTS[:1]).values == fit(MODEL, PARTS[0]).values
    with pytest.raises(JointIdError, match="no recording"):
        together(MODEL, [])


def test_the_command_takes_several_files(tmp_path, run):
    paths = []
    for k, part in enumerate(PARTS[:2]):
        paths.append(tmp_path / f"{k}.csv")
        formats.write_csv(paths[-1], part)
    code, out, err = run("fit", *paths, "--model", "rigid_joint")
    assert (code, err) == (0, "") and "2 recordings agree" in out and "1.csv: converged; J" in out
    other = tmp_path / "other.csv"
    formats.write_csv(other, PARTS[0])
    code, out, _ = run("fit", *paths, "--model", "rigid_joint", "--json", "--validate", other)
    result = json.loads(out)
    assert code == 0 and [r["status"] for r in result["recordings"]] == ["converged", "converged"]
    assert result["validation"][0]["nrmse"] < 0.1
    code, _, err = run("fit", *paths, "--model", "rigid_joint", "--plot", tmp_path / "x.png")
    assert code == 2 and "--plot shows one recording" in err


@pytest.mark.long
def test_the_command_fits_every_joint_of_a_bag(tmp_path, run):
    bag = tmp_path / "arm"
    formats.write_bag(bag, {"lift": PARTS[0], "elbow": PARTS[1]})
    code, out, err = run("fit", bag, "--model", "rigid_joint", "--joint", "all")
    assert (code, err) == (0, "")
    rows = [line.split()[:3] for line in out.splitlines()[1:3]]
    assert rows == [[joint, "rigid_joint", "converged"] for joint in ("lift", "elbow")]
    code, out, _ = run("fit", bag, "--model", "rigid_joint", "--joint", "all", "--json")
    assert [(e["joint"], e["status"]) for e in json.loads(out)] == [("lift", "converged"), ("elbow", "converged")]
    code, _, err = run("fit", bag, "--model", "rigid_joint", "--joint", "all", "--save", tmp_path / "x.json")
    assert code == 2 and "--save is for one joint" in err


def test_every_joint_of_a_file_without_names_is_refused(tmp_path, run):
    path = tmp_path / "one.csv"
    formats.write_csv(path, PARTS[0])
    code, _, err = run("fit", path, "--model", "rigid_joint", "--joint", "all")
    assert code == 2 and "needs a file with several joints" in err


def test_an_offset_is_known_no_better_than_in_one_recording():
    """Recordings whose offsets happen to be alike once gave an offset that was known ten times better than in each."""
    alike = [record(seed, 0.5) for seed in (1, 2, 3)]
    found = fit_several(MODEL, alike)
    each = [one["tau_0"] for one in found.alone]
    assert found.estimate["tau_0"].std_dev >= np.sqrt(np.mean([row.std_dev**2 for row in each]))
    assert abs(found.estimate["tau_0"].value - 0.5) < 2.0 * found.estimate["tau_0"].std_dev
