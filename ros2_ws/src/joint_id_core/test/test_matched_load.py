"""A load whose description has other masses than the arm: it is matched to the motion, and intervals reckon with it."""

from __future__ import annotations

import functools
import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.load_errors import SampledErrors
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit, fit_several
from joint_id_core.estimators.matched_load import MatchedLoad
from joint_id_core.models import build

from . import moving_arm
from .moving_arm import CARRYING, COULOMB, JOINTS, ROTOR, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.arm.typical_inertia import typical_inertia

RIGID, LOAD = build("rigid_joint"), "external_torque"
DRIVEN = build("rigid_joint", actuation="current")
GAIN = 0.85  # of the torque constant that the user takes over the true one
ESTIMATORS = [Innovations(), Regression()]
NAMES = [one.name for one in ESTIMATORS]


def real(seed: int, urdf: str = URDF, spread: float = 0.25) -> str:
    """The arm as it was built: other masses, and centres of mass some cm away."""
    rng = np.random.default_rng([seed, 7])

    def mass(found: re.Match[str]) -> str:
        return f'mass value="{float(found[1]) * np.exp(spread * rng.standard_normal())}"'

    def centre(found: re.Match[str]) -> str:
        moved = [float(part) + 0.1 * spread * rng.standard_normal() for part in found[1].split()]
        return f'<origin xyz="{" ".join(map(str, moved))}" rpy="0 0 0.3"/>'

    other = re.sub(r'mass value="([^"]*)"', mass, urdf)
    return re.sub(r'<origin xyz="([^"]*)" rpy="0 0 0.3"/>', centre, other)


@functools.cache
def moved(urdf: str, seed: int, seconds: float = 12.0) -> dict[str, Recording]:
    recordings = moving_arm.rigid(seconds, seed, urdf)
    return {n: r.with_channels({"torque": GAIN * r["torque"]}) for n, r in recordings.items()}


def described(urdf: str, name: str, *seeds: int) -> list[Recording]:
    """Recordings of a joint of that arm, with the load of the description that its user has."""
    return list(loaded(Description(URDF), name, [moved(urdf, seed) for seed in seeds]).recordings)


def truth(urdf: str, name: str) -> dict[str, float]:
    """In units of the torque constant that the user takes."""
    k = JOINTS.index(name)
    inertia = ROTOR[k] + typical_inertia(Description(urdf))[k]
    return {n: GAIN * value for n, value in (("J", inertia), ("c", VISCOUS[k]), ("tau_f", COULOMB[k]))}


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=NAMES)
@pytest.mark.parametrize("name", first_quick(["lift", "turn", "bend", "roll", "tilt", "spin"]))
def test_friction_and_inertia_are_right_though_masses_and_torque_constants_are_not(name, estimator):
    urdf = real(1)
    estimate = fit(RIGID, described(urdf, name, 1)[0], None, estimator)
    assert estimate.converged, estimate.message
    for parameter, value in truth(urdf, name).items():
        row = estimate[parameter]
        assert abs(row.value - value) < 4.0 * row.std_dev, (parameter, row, value)
        assert row.std_dev < 0.03 * value


@pytest.mark.parametrize("estimator", first_quick(ESTIMATORS), ids=NAMES)
def test_without_that_the_inertia_is_far_off(estimator):
    """Otherwise the test above would show nothing."""
    urdf = real(1)
    off = []
    for name in ("turn", "lift"):
        raw = replace(described(urdf, name, 1)[0], load_errors=None)
        estimate = fit(RIGID, raw, None, estimator)
        row = estimate["J"]
        off.append(not estimate.converged or abs(row.value - truth(urdf, name)["J"]) > 0.1 * row.value)
    assert any(off)


@pytest.mark.parametrize("estimator", first_quick(ESTIMATORS), ids=NAMES)
@pytest.mark.parametrize("name", first_quick(["roll", "lift", "spin"]))
def test_a_tool_that_the_description_lacks_is_told(name, estimator):
    estimate = fit(RIGID, described(CARRYING, name, 1)[0], None, estimator)
    assert estimate.converged, estimate.message
    for parameter, value in truth(CARRYING, name).items():
        assert abs(estimate[parameter].value - value) < 4.0 * estimate[parameter].std_dev, parameter
    assert "perhaps a tool is missing (joint-id arm fit --out" in estimate.message


def test_the_load_of_the_right_description_stays_as_it_is():
    recording = loaded(Description(URDF), "bend", [moving_arm.rigid(12.0, 1)]).recordings[0]
    found = MatchedLoad(RIGID, [recording], None).of(recording)[LOAD]
    size = np.sqrt(np.nanmean(recording[LOAD] ** 2))
    assert np.sqrt(np.nanmean((found - recording[LOAD]) ** 2)) < 0.003 * size
    assert not any("matched" in note for note in fit(RIGID, recording).notes)


def test_it_is_the_load_of_other_motions_too():
    """As where a fit is to predict another recording: what is added to its load comes from the first one."""
    urdf = real(2)
    first, other = described(urdf, "lift", 1, 2)
    found = MatchedLoad(RIGID, [first], None).of(other)
    exact = loaded(Description(urdf), "lift", [moved(urdf, 2)]).recordings[0]
    before = other[LOAD] - GAIN * exact[LOAD]
    after = found[LOAD] - GAIN * exact[LOAD]
    assert found.load_errors is None and LOAD in found.derived
    assert np.nanstd(after) < 0.1 * np.nanstd(before)
    assert np.nanstd(before) > 0.1 * np.nanstd(exact[LOAD])


def test_recordings_that_are_fitted_together_have_one_load():
    urdf = real(3)
    recordings = described(urdf, "lift", 1, 2)
    both = fit_several(RIGID, recordings, None, Regression())
    for parameter, value in truth(urdf, "lift").items():
        row = both.estimate[parameter]
        assert abs(row.value - value) < 4.0 * row.std_dev, (parameter, row, value)
        assert row.std_dev <= 1.25 * min(one[parameter].std_dev for one in both.alone)


def test_what_is_not_known_of_the_load_widens_the_intervals():
    """Against the scatter of least squares when the load is drawn from its prior, where the motion does not tell it."""
    recording = loaded(Description(URDF), "lift", [moving_arm.rigid(12.0, 1)]).recordings[0]
    alone = fit(RIGID, replace(recording, load_errors=None), None, Regression())
    with_errors = fit(RIGID, recording, None, Regression())
    for name in ("J", "c", "tau_f"):
        assert with_errors[name].std_dev > alone[name].std_dev
        assert abs(with_errors[name].value - alone[name].value) < 4.0 * with_errors[name].std_dev


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=NAMES)
@pytest.mark.parametrize(("seed", "name"), first_quick([(1, "bend"), (2, "lift"), (3, "lift")]))
def test_a_torque_constant_that_is_free_is_known_no_better_than_the_masses(seed, name, estimator):
    urdf = real(seed)
    recording = described(urdf, name, 1)[0]
    recording = recording.with_channels({"current": recording["torque"]})
    estimate = fit(DRIVEN, recording, ParameterSettings({"N": 1.0, "k_t": 1.0}, freed=["k_t"]), estimator)
    assert estimate.converged and "known no better than the load" in estimate.message
    for parameter, value in {"k_t": 1.0 / GAIN, **{n: v / GAIN for n, v in truth(urdf, name).items()}}.items():
        row = estimate[parameter]
        assert abs(row.value - value) < 2.0 * row.std_dev, (parameter, row, value)
        assert 0.1 * row.value < row.std_dev < 0.5 * row.value
    held = fit(DRIVEN, recording, ParameterSettings({"N": 1.0, "k_t": 1.0}), estimator)
    assert held["J"].std_dev < 0.05 * held["J"].value and "no better" not in held.message


@pytest.mark.parametrize("size", [0.02, 1.0, 30.0])
def test_the_prior_of_the_factors_is_as_wide_as_they_are(size):
    """Errors over standard deviations, over many draws: neither too narrow for large factors nor too wide for none."""
    from joint_id_core.estimators.matched_load import _solved

    rng = np.random.default_rng(0)
    off, widest = [], []
    for _ in range(200):
        errors, true = rng.standard_normal((40, 12)), size * rng.standard_normal(12)
        y = errors @ true + 3.0 * rng.standard_normal(40)
        factors, covariance, _ = _solved(errors.T @ errors / 9.0, errors.T @ y / 9.0)
        off.append((factors - true) / np.sqrt(np.diag(covariance)))
        widest.append(np.sqrt(np.diag(covariance)).mean())
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.15
    assert np.mean(widest) < 0.65  # 0.49 by least squares alone, 0.29 by one that is known to be exact


def test_errors_between_their_instants_are_a_straight_line():
    errors = SampledErrors(np.array([0.0, 1.0]), np.array([[0.0, 1.0], [2.0, -1.0]]), "a load")
    np.testing.assert_allclose(errors.at(np.array([0.25, 0.5])), [[0.5, 0.5], [1.0, 0.0]])
    assert np.isnan(errors.at(np.array([-1.6, 2.6]))).all()


def test_loads_of_two_descriptions_are_refused():
    one = described(URDF, "lift", 1)[0]
    other = loaded(Description(URDF, "other.urdf"), "lift", [moved(URDF, 2)]).recordings[0]
    with pytest.raises(JointIdError, match="one description"):
        fit_several(RIGID, [one, other])


def test_a_model_without_a_load_does_not_need_it():
    recording = described(URDF, "lift", 1)[0]
    assert MatchedLoad(build("motor_side"), [recording], None).of(recording).load_errors is None
