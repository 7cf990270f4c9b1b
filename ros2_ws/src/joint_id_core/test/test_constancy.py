"""Joints that change within a recording: intervals contain both values, and the message names them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, Regression, constancy, fit
from joint_id_core.estimators.constancy import Pull, with_constancy
from joint_id_core.models import build
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import JointSimulator, simulate

from .friction_record import TRUTH
from .quick import first_quick

RIGID = build("rigid_joint")
LIGHT, LOADED = TRUTH, TRUTH | {"J": 1.4 * TRUTH["J"]}
TIME = np.arange(2400) / 400


def part(values: dict[str, float], seed: int) -> Recording:
    """Six seconds of a joint whose torque has noise that the recording does not show."""
    torque = multisine(TIME, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(len(TIME))
    moved = simulate(RIGID, TIME, {"torque": torque + noise}, values)
    seen = Sensors(noise={"link_position": 1e-5}).measure(moved, seed, keep=("link_position",))
    return seen.with_channels({"torque": torque})


def joined(first: Recording, second: Recording) -> Recording:
    """One recording of both, with a pause between them."""
    channels = {n: np.concatenate([first[n], second[n]]) for n in first.channels}
    return Recording(np.concatenate([first.time, 7.0 + second.time]), channels)


@pytest.fixture(scope="module")
def loaded() -> tuple[Recording, Recording]:
    return part(LIGHT, 1), part(LOADED, 2)


def test_a_load_that_changes_midway_is_in_the_interval_and_named(loaded):
    found = fit(RIGID, joined(*loaded))
    J = found["J"]
    for true in (LIGHT["J"], LOADED["J"]):
        assert abs(J.value - true) < 2.0 * J.std_dev
    if found.status is Status.CONVERGED:
        assert "halves of the recording" in found.message
        first, second = map(float, re.search(r"J about (\S+) in the first half and (\S+) in", found.message).groups())
        alone = [fit(RIGID, one)["J"].value for one in loaded]
        assert [first, second] == pytest.approx(alone, rel=0.1)


def test_the_whole_covariance_widens_with_its_parameters(loaded):
    recording = joined(*loaded)
    alone = Innovations().fit(RIGID, recording)
    found = with_constancy(replace(alone, status=Status.CONVERGED), RIGID, recording, None)
    sigma = np.sqrt(np.diag(found.covariance))
    assert found["J"].std_dev > 5.0 * alone["J"].std_dev
    np.testing.assert_allclose(sigma, [found[n].std_dev for n in found.free])
    before, after = (c.covariance / np.outer(*(2 * [np.sqrt(np.diag(c.covariance))])) for c in (alone, found))
    np.testing.assert_allclose(after, before, atol=1e-12)  # correlations stay


def test_a_joint_that_stays_the_same_keeps_its_intervals():
    kept = []
    for seed in range(8):
        recording = joined(part(LIGHT, 10 + seed), part(LIGHT, 30 + seed))
        alone = Innovations().fit(RIGID, recording)
        assert alone.converged
        kept.append(with_constancy(alone, RIGID, recording, None) is alone)
    assert sum(kept) >= 7, "a correct model scatters more than foreseen once in hundred fits"


def test_what_is_known_only_to_its_order_of_magnitude_is_no_estimate(loaded, monkeypatch):
    alone = Innovations().fit(RIGID, loaded[0])
    none = np.zeros(len(alone.free))
    far = np.where(np.array(alone.free) == "J", 1.5, 0.0)  # a factor of 4.5 either way
    monkeypatch.setattr(constancy, "pull_of", lambda *_: Pull(none + 0.01, none, far, far > 0.0))
    found = with_constancy(alone, RIGID, loaded[0], None)
    assert alone["J"].verdict is Verdict.ESTIMATED and found["J"].verdict is Verdict.PRIOR
    assert found["c"] == alone["c"] and found.status is Status.CONVERGED


def test_an_estimate_that_is_not_converged_stays_as_it_is(loaded):
    recording = joined(*loaded)
    alone = replace(Innovations().fit(RIGID, recording), status=Status.POOR_FIT)
    assert with_constancy(alone, RIGID, recording, None) is alone


@pytest.mark.parametrize("name", first_quick(["c", "tau_f"]))
def test_friction_that_drifts_is_in_the_interval_of_a_regression_and_named(name):
    """Its residuals have a long memory, but their covariance left both ends 6 standard deviations away."""
    found = fit(RIGID, drifting({name: 0.3 * TRUTH[name]}, 1), estimator=Regression())
    row = found[name]
    for true in (TRUTH[name], 1.3 * TRUTH[name]):
        assert abs(row.value - true) < 2.5 * row.std_dev
    assert f"{name} about" in found.message and "halves of the recording" in found.message
    for other in {"J", "c", "tau_f"} - {name}:
        assert abs(found[other].value - TRUTH[other]) < 3.0 * found[other].std_dev < 0.05 * TRUTH[other]


@pytest.mark.long
def test_a_regression_of_a_joint_that_stays_the_same_names_no_halves():
    told = [n for seed in range(8) for n in fit(RIGID, drifting({}, 10 + seed), estimator=Regression()).notes]
    assert not any("halves" in note for note in told)


def drifting(change: dict[str, float], seed: int) -> Recording:
    """Half a minute of a joint whose parameters change by so much from begin to end, in steps of 0.1 s."""
    time, rng = np.arange(6000) / 200, np.random.default_rng(seed)
    torque = multisine(time, 25.0, (0.3, 0.7, 1.3, 2.1), seed=5)
    pushed, angle, joint = torque + 0.1 * rng.standard_normal(len(time)), [], JointSimulator(RIGID, TRUTH)
    for k, (now, push) in enumerate(zip(time.tolist(), pushed.tolist(), strict=True)):
        if change and k % 20 == 0:
            joint.change(TRUTH | {n: TRUTH[n] + by * now / time[-1] for n, by in change.items()})
        angle.append(joint.state["link_position"])
        joint.advance(1 / 200, {"torque": push})
    seen = np.array(angle) + 1e-5 * rng.standard_normal(len(time))
    return Recording(time, {"link_position": seen, "torque": torque}, source="drifting")
