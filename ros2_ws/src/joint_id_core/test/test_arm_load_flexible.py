"""Flexible joints of an arm that all move: the paper's Models 2 and 3 beneath the load that its description gives."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, LINK_VISCOUS, RATIO, ROTOR, STIFFNESS, URDF, VISCOUS
from .test_matched_load import real

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.arm.typical_inertia import typical_inertia

FLEXIBLE, ELECTROMECHANICAL = build("harmonic_drive"), build("electromechanical")
SIGMA = {"c_1": 1.0, "R": 0.05, "k_b": 0.05}  # over the value; the others scale with a load that is known to 20 %
pytestmark = pytest.mark.long


@pytest.mark.parametrize("name", JOINTS)
def test_flexible_joints_are_found_while_all_of_them_move(flexible, name):
    """The paper's Model 2 holds while other joints move, with a load that follows the pose."""
    found, k = loaded(Description(URDF), name, [flexible]), JOINTS.index(name)
    held = ParameterSettings({"N": RATIO, "k_2": 0.0, "tau_fq": 0.0}, fixed=["k_2", "tau_fq"])
    estimate = fit(FLEXIBLE, found.recordings[0], held)
    assert estimate.status in (Status.CONVERGED, Status.POOR_FIT)
    truth = {
        "J_m": ROTOR[k] / RATIO**2, "k_1": STIFFNESS[k], "J_q": found.inertia, "c_q": LINK_VISCOUS * VISCOUS[k],
        "c_m": (1.0 - LINK_VISCOUS) * VISCOUS[k] / RATIO**2, "tau_fm": COULOMB[k] / RATIO,
        "c_1": moving_arm.DAMPING_S * STIFFNESS[k],
    }  # fmt: skip
    for parameter, value in truth.items():
        row = estimate[parameter]
        assert abs(row.value - value) < 4.0 * row.std_dev, (parameter, row, value)


@pytest.mark.parametrize("name", ["lift", "roll", "spin"])
def test_flexible_joints_are_found_though_masses_of_the_description_are_off(flexible, name):
    """As computed, the load leaves poor fits; the one that suits the motion of a rigid joint does not."""
    found, k = loaded(Description(real(1)), name, [flexible]), JOINTS.index(name)
    held = ParameterSettings({"N": RATIO, "k_2": 0.0, "tau_fq": 0.0}, fixed=["k_2", "tau_fq"])
    estimate = fit(FLEXIBLE, found.recordings[0], held)
    assert estimate.converged and "the load was matched" in estimate.message.lower()
    truth = {
        "J_m": ROTOR[k] / RATIO**2, "k_1": STIFFNESS[k], "J_q": typical_inertia(Description(URDF))[k],
        "c_q": LINK_VISCOUS * VISCOUS[k], "c_m": (1.0 - LINK_VISCOUS) * VISCOUS[k] / RATIO**2,
        "tau_fm": COULOMB[k] / RATIO,
    }  # fmt: skip
    for parameter, value in truth.items():
        row = estimate[parameter]
        assert abs(row.value - value) < 4.0 * row.std_dev, (parameter, row, value)
        assert row.std_dev < (0.4 if parameter == "J_q" else 0.03) * value, (parameter, row)


@pytest.fixture(scope="module")
def flexible() -> dict[str, Recording]:
    return moving_arm.flexible(20.0)


@pytest.mark.parametrize("name", ["turn", "lift", "tilt"])
def test_flexible_joints_with_their_motors_are_found_while_all_of_them_move(electrical, name):
    """The paper's Model 3 does, from voltages; it starts from a data sheet, and the inertia of the description."""
    found, k = loaded(Description(URDF), name, [electrical]), JOINTS.index(name)
    truth = {
        "R": 0.5, "k_b": 0.1, "k_t": 0.1, "J_m": ROTOR[k] / RATIO**2, "k_1": STIFFNESS[k], "J_q": found.inertia,
        "c_q": LINK_VISCOUS * VISCOUS[k], "c_m": (1.0 - LINK_VISCOUS) * VISCOUS[k] / RATIO**2,
        "tau_fm": COULOMB[k] / RATIO, "c_1": moving_arm.DAMPING_S * STIFFNESS[k],
    }  # fmt: skip
    start = {n: 1.1 * truth[n] for n in ("R", "k_b", "k_t")} | {"J_m": 1.2 * truth["J_m"], "J_q": found.inertia}
    held = {"N": RATIO, "k_2": 0.0, "L": moving_arm.ELECTRICAL["L"], "c_b": 0.0}
    settings = ParameterSettings({**start, **held}, fixed=["k_2"], freed=["J_m", "J_q"])
    estimate = fit(ELECTROMECHANICAL, found.recordings[0], settings)
    assert estimate.status in (Status.CONVERGED, Status.POOR_FIT)
    for parameter, value in truth.items():
        row = estimate[parameter]
        assert abs(row.value - value) < 4.0 * row.std_dev, (parameter, row, value)
        assert row.std_dev < SIGMA.get(parameter, 0.25) * value, (parameter, row)
    ratio = estimate["k_1"].value / estimate["k_t"].value  # the load tells the scale of both
    assert abs(ratio / (truth["k_1"] / truth["k_t"]) - 1.0) < 0.02


@pytest.mark.parametrize("name", ["turn", "lift"])
def test_without_a_torque_the_masses_of_a_description_are_all_that_tells_the_scale(electrical, name):
    """Masses that are 25 % off give a torque constant, and all that scales with it, that are 20 to 30 % off."""
    found, k = loaded(Description(real(1)), name, [electrical]), JOINTS.index(name)
    truth = {"R": 0.5, "k_b": 0.1, "k_t": 0.1, "k_1": STIFFNESS[k], "tau_fm": COULOMB[k] / RATIO}
    start = {n: 1.1 * truth[n] for n in ("R", "k_b", "k_t")} | {"J_m": ROTOR[k] / RATIO**2, "J_q": found.inertia}
    held = {"N": RATIO, "k_2": 0.0, "L": moving_arm.ELECTRICAL["L"], "c_b": 0.0}
    settings = ParameterSettings({**start, **held}, fixed=["k_2"], freed=["J_m", "J_q"])
    estimate = fit(ELECTROMECHANICAL, found.recordings[0], settings)
    assert estimate.converged and "No torque is measured" in estimate.message
    for parameter, value in truth.items():
        row = estimate[parameter]
        assert abs(row.value - value) < 2.0 * row.std_dev, (parameter, row, value)
        assert row.std_dev < SIGMA.get(parameter, 0.25) * value, (parameter, row)


@pytest.fixture(scope="module")
def electrical() -> dict[str, Recording]:
    return moving_arm.flexible(12.0, electrical=True)


@pytest.mark.parametrize("name", JOINTS)
def test_motors_and_gears_are_found_without_a_description_beneath_a_load_that_drifts(flexible, name):
    """What the rest of the arm puts on the link is not recorded; c_1 is off, as other joints vibrate, too."""
    held = ParameterSettings({"N": RATIO, "k_2": 0.0, "tau_fq": 0.0}, fixed=["k_2", "tau_fq"])
    estimate, k = fit(build("harmonic_drive", drifting_load=True), flexible[name], held), JOINTS.index(name)
    assert estimate.status in (Status.CONVERGED, Status.POOR_FIT)
    truth = {
        "J_m": ROTOR[k] / RATIO**2, "k_1": STIFFNESS[k], "tau_fm": COULOMB[k] / RATIO,
        "c_m": (1.0 - LINK_VISCOUS) * VISCOUS[k] / RATIO**2,
    }  # fmt: skip
    for parameter, value in truth.items():
        assert abs(estimate[parameter].value - value) < 0.03 * value, estimate[parameter]
    description = Description(URDF)
    poses = np.column_stack([flexible[joint]["link_position"][::50] for joint in description.joints])
    still = np.zeros_like(poses)
    inertia = description.loads(poses, still, still).inertia[:, description.joints.index(name)].mean()
    assert abs(estimate["J_q"].value - inertia) < 4.0 * estimate["J_q"].std_dev
