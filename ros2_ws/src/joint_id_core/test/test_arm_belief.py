"""What is known of an arm, and how equations make it sharper."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, ROTOR, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm import belief_file
from joint_id_core.arm.belief import Belief
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, Equations, equations, joined
from joint_id_core.arm.faults import Faults
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.information import sum_of
from joint_id_core.arm.learning import learned
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import MARGIN_S

REGRESSOR = Regressor(Description(URDF, "arm.urdf"))
GAINS = {name: {"torque": 1.0} for name in JOINTS}


def motion(seconds: float, seed: int) -> Equations:
    plain = equations(REGRESSOR, moving_arm.rigid(seconds, seed), GAINS, "arm")
    inertial = np.append(REGRESSOR.reference, np.zeros(PAYLOAD))
    whole = Friction.from_values(REGRESSOR, inertial).added(plain)
    return whole.between(MARGIN_S, seconds - MARGIN_S)  # filters are less accurate near the ends


@pytest.fixture(scope="module")
def known() -> Belief:
    return learned([motion(15.0, 0)])


@pytest.fixture(scope="module")
def more() -> list[Equations]:
    whole = motion(6.0, 1)
    return [whole.between(k, k + 1.0) for k in range(1, 5)]


def rows(belief: Belief, part: Equations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns of all parameters, torques, and variances of one stretch, joint by joint."""
    columns, y, variance = [], [], []
    for j in range(len(JOINTS)):
        used = part.used[:, j]
        offset = np.zeros((np.count_nonzero(used), len(JOINTS)))
        offset[:, j] = 1.0
        columns.append(np.concatenate([part.columns[used, j], offset], axis=1))
        y.append(part.y[used, j])
        variance.append(np.full(len(offset), belief.sigma[j] ** 2 * belief.colour[j]))
    return np.concatenate(columns), np.concatenate(y), np.concatenate(variance)


def off(belief: Belief) -> np.ndarray:
    """Errors of base parameters and friction over their standard deviations."""
    base = REGRESSOR.reference + np.concatenate([ROTOR, np.zeros(belief.base - len(ROTOR))])
    truth = np.concatenate([base, VISCOUS, COULOMB])
    place = np.r_[: belief.base, belief.friction][: belief.base + 2 * len(JOINTS)]
    return (belief.values[place] - truth) / np.sqrt(np.diag(belief.covariance)[place])


def test_it_begins_as_the_fit_of_the_whole_arm(known):
    z = off(known)
    assert np.abs(z).max() < 4.5 and np.mean(np.abs(z) < 1.96) > 0.85
    assert known.r_squared.min() > 0.99
    assert not known.carries and not known.values[known.payload].any()
    assert np.linalg.eigvalsh(known.covariance / np.abs(known.covariance).max()).min() > -1e-9


def test_equations_make_it_what_the_rule_of_bayes_says(known, more):
    columns, y, variance = rows(known, more[0])
    active = np.delete(np.arange(len(known.values)), known.payload)
    columns, prior = columns[:, active], known.covariance[np.ix_(active, active)]
    gain = prior @ columns.T @ np.linalg.inv(columns @ prior @ columns.T + np.diag(variance))
    values = known.values[active] + gain @ (y - columns @ known.values[active])
    found = known.told(known.information(more[:1]))
    sigma = np.sqrt(np.diag(found.covariance)[active])
    np.testing.assert_allclose(found.values[active] / sigma, values / sigma, atol=1e-3)
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(prior - gain @ columns @ prior)), rtol=1e-3)
    assert not found.values[found.payload].any()


def test_evidence_is_the_likelihood_of_the_torques(known, more):
    """But for a constant: so it is compared between two beliefs."""
    from scipy.stats import multivariate_normal  # takes a second, which other tests need not wait for

    columns, y, variance = rows(known, more[0])
    open_ = known.widened(known.friction_of(1), np.array([3.0, 2.0, 1.0]))
    pair = []
    for belief in (known, open_):
        spread = columns @ belief.covariance @ columns.T + np.diag(variance)
        pair.append(2.0 * multivariate_normal.logpdf(y, columns @ belief.values, spread))
    told = known.information(more[:1])
    assert open_.evidence(told) - known.evidence(told) == pytest.approx(pair[1] - pair[0], abs=0.05)


def test_information_is_the_same_beside_other_values(known, more):
    other = replace(known, values=known.values + 0.1)
    moved, anew = known.information(more).beside(other.values), other.information(more)
    np.testing.assert_allclose(moved.vector, anew.vector, rtol=1e-6, atol=1e-6 * np.abs(anew.vector).max())
    assert moved.energy == pytest.approx(anew.energy, rel=1e-6)


def test_parts_tell_what_the_whole_tells(known, more):
    parts = [known.information([part]) for part in more]
    together, whole = sum_of(parts), known.information([joined(more)])
    assert together is not None and sum_of([]) is None
    np.testing.assert_allclose(together.matrix, whole.matrix, rtol=1e-9, atol=1e-9 * np.abs(whole.matrix).max())
    assert together.energy == pytest.approx(whole.energy)


def test_it_stays_honest_while_it_grows_sharper(known, more):
    found = known
    for seed in (2, 3):
        whole = motion(15.0, seed)
        for k in range(30):
            found = found.after(whole.between(0.5 * k, 0.5 * k + 0.5))
    z = off(found)
    assert np.abs(z).max() < 4.5 and 0.6 < np.sqrt(np.mean(z**2)) < 1.4
    before, after = (np.sqrt(np.diag(b.covariance))[: b.base] for b in (known, found))
    assert np.median(after / before) < 0.8
    # Friction may change with temperature: by 5 % in ten minutes.
    friction = slice(found.friction.start, found.friction.start + 2 * len(JOINTS))
    assert np.all(np.sqrt(np.diag(found.covariance))[friction] < 0.03 * found.values[friction])
    assert found.duration > known.duration + 20.0


def test_a_payload_has_parameters_of_its_own(known):
    sigma = np.full(10, 2.0)
    carrying = known.with_payload(sigma)
    np.testing.assert_array_equal(np.diag(carrying.covariance)[carrying.payload], 4.0)
    empty = carrying.with_payload(None)
    np.testing.assert_array_equal(empty.covariance, known.covariance)


def test_residuals_with_a_memory_are_seen(known):
    part = motion(12.0, 4)
    wave = 10.0 * known.sigma[2] * np.sin(2.0 * np.pi * 0.1 * part.time)
    y = part.y.copy()
    y[:, 2] += wave
    coloured = replace(part, y=y)
    found = known
    for k in range(24):
        found = found.after(coloured.between(0.5 * k, 0.5 * k + 0.5))
    assert found.colour[2] > known.colour[2] + 0.1
    assert abs(found.colour[0] - known.colour[0]) < 0.1 * known.colour[0] + 0.1


def test_faults_move_it_as_they_move_its_values(known, more):
    """Also those of a payload that is picked up. Values are linear in torques, so that is exact."""
    fault, part = 0.1 * np.sin(more[0].y), more[0]
    faulty = replace(part, y=part.y + fault)
    carrying = known.with_payload(np.full(PAYLOAD, 2.0))
    for belief in (known, carrying):
        right, wrong = belief.after(part), belief.after(faulty)
        found = wrong.with_faults(belief, faulty, fault)
        assert np.abs(found.faults.shift[found.offsets]).min() > 0.0
        assert bool(found.faults.shift[found.payload].any()) is belief.carries
        sigma = np.sqrt(np.diag(found.covariance) + 1e-12)
        np.testing.assert_allclose(found.faults.shift / sigma, (wrong.values - right.values) / sigma, atol=1e-6)
    put_down = found.with_payload(None)
    assert not put_down.faults.shift[put_down.payload].any()


# --- the file


def test_it_is_kept_in_a_file(known, tmp_path):
    faults = Faults(("the torques seem to be late",), 0.1 * known.values, "gross", {"late": 0.005})
    carrying = replace(known.with_payload(np.full(10, 2.0)), faults=faults)
    path = tmp_path / "arm.json"
    belief_file.write(path, carrying, REGRESSOR, GAINS)
    again = belief_file.read(path, REGRESSOR, GAINS)
    np.testing.assert_array_equal(again.covariance, carrying.covariance)
    np.testing.assert_array_equal(again.values, carrying.values)
    assert again.carries and again.duration == carrying.duration and again.base == carrying.base
    np.testing.assert_array_equal(again.scores.products, carrying.scores.products)
    np.testing.assert_array_equal(again.faults.shift, faults.shift)
    assert replace(again.faults, shift=faults.shift) == faults


def test_a_file_that_does_not_fit_is_refused(known, tmp_path):
    path = tmp_path / "arm.json"
    with pytest.raises(JointIdError, match="cannot be read"):
        belief_file.read(path, REGRESSOR, GAINS)
    belief_file.write(path, known, REGRESSOR, GAINS)
    with pytest.raises(JointIdError, match="other torque constants"):
        belief_file.read(path, REGRESSOR, {name: {"torque": 2.0} for name in JOINTS})
    heavier = Regressor(Description(URDF.replace('mass value="8.0"', 'mass value="9.0"'), "arm.urdf"))
    with pytest.raises(JointIdError, match="another description"):
        belief_file.read(path, heavier, GAINS)
    content = json.loads(path.read_text())
    for damage in (
        {"sigma": content["sigma"][:-1]},
        {"covariance": content["covariance"][:-1]},
        {"values": [None, *content["values"][1:]]},
        {"sigma": [0.0, *content["sigma"][1:]]},
        {"scores": {}},
        {"faults": content["faults"] | {"shift": [0.0]}},
        {"faults": content["faults"] | {"amounts": {"late": float("nan")}}},
        {"duration": float("nan")},
    ):
        path.write_text(json.dumps(content | damage))
        with pytest.raises(JointIdError, match="damaged"):
            belief_file.read(path, REGRESSOR, GAINS)
    path.write_text(json.dumps(content | {"version": 99}))
    with pytest.raises(JointIdError, match="version 99"):
        belief_file.read(path, REGRESSOR, GAINS)
    path.write_text("{")
    with pytest.raises(JointIdError, match="no file of joint_id"):
        belief_file.read(path, REGRESSOR, GAINS)
