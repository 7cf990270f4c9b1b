"""Gears that twist little, and links that something moves which nothing records."""

from __future__ import annotations

import math

import numpy as np
import pytest

from joint_id_core import ParameterSettings, fit
from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import complete
from joint_id_core.models import build
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import ControlledJoint
from joint_id_core.simulation.sensors import Sensors

from .quick import first_quick

N, RATE = 100.0, 500
JOINT = {"N": N, "J_m": 5e-5, "c_m": 1e-4, "tau_fm": 0.01, "J_q": 0.5, "c_q": 0.3, "tau_fq": 0.4, "k_2": 1e7}
ENCODER = 2.0 * math.pi / 2**17  # rad
GEAR = ("J_m", "k_1")
INERTIAS = (*GEAR, "J_q")
UR = ("link_position", "motor_velocity", "torque")


def moved(resonance_hz: float, fastest_hz: float, hidden: float = 0.0, seed: int = 1) -> Recording:
    """What a robot records of a joint whose link swings so fast on its gear, under a `hidden` load (Nm)."""
    stiffness = JOINT["J_q"] * (2.0 * math.pi * resonance_hz) ** 2
    truth = {**JOINT, "k_1": stiffness, "c_1": 0.1 * math.sqrt(stiffness * JOINT["J_q"])}
    model, reference = build("harmonic_drive"), position_reference(0.4, 0.2, fastest_hz, 5.0, seed)
    noise = {"link_position": 5e-6, "motor_velocity": 0.05}
    sensors = Sensors(noise=noise, quantum={"link_position": ENCODER})
    controller = controller_of(model, model.values(truth))
    joint = ControlledJoint(model, controller, reference, truth, sensors=sensors, seed=seed)
    load, rng, rows = position_reference(1.0, 0.3, 2.0, 10.0, 10 + seed), np.random.default_rng(seed), []
    for k in range(12 * RATE):
        torque, shown = joint.command(), joint.shown
        rows.append([shown["link_position"], shown["motor_velocity"], torque])
        acting = {"torque": torque + 1e-3 * rng.standard_normal(), "external_torque": hidden * load.value(k / RATE)}
        joint.joint.advance(1.0 / RATE, acting)
    values = np.array(rows).T
    return Recording(np.arange(len(rows)) / RATE, dict(zip(UR, values, strict=True)), source="moved")


def fitted(name: str, recording: Recording, **options: bool) -> Estimate:
    return fit(build(name, **options), recording, ParameterSettings({"N": N}))


def errors(estimate: Estimate, resonance_hz: float, names: tuple[str, ...] = GEAR) -> dict[str, float]:
    """Errors in standard deviations."""
    truth = {**JOINT, "k_1": JOINT["J_q"] * (2.0 * math.pi * resonance_hz) ** 2}
    return {name: abs(estimate[name].value - truth[name]) / estimate[name].std_dev for name in names}


@pytest.mark.parametrize("resonance_hz", first_quick([50.0, 40.0]))
def test_a_gear_that_twists_little_is_not_told_by_the_motor_alone(resonance_hz):
    """The motor with the link's inertia explains the motion: J_m was `converged` and many standard deviations off."""
    found = fitted("motor_side", moved(resonance_hz, 3.0))
    assert max(errors(found, resonance_hz).values()) > 8.0, "what is at stake"
    assert found.status is Status.POOR_FIT and "carries" in found.message and "harmonic_drive" in found.message


@pytest.mark.parametrize("name", first_quick(["motor_side", "harmonic_drive"]))
def test_a_gear_that_twists_more_is(name):
    found = fitted(name, moved(8.0, 8.0))
    assert found.converged, found.message
    assert max(errors(found, 8.0).values()) < 4.0
    assert all(found[name].std_dev < 0.1 * found[name].value for name in GEAR)


@pytest.mark.long
@pytest.mark.parametrize("hidden", first_quick([3.0, 0.0, 15.0]))
def test_with_a_drifting_load_a_joint_is_known_whatever_moves_its_link(hidden):
    """15 Nm are seven times the torque that the link's own inertia and friction need."""
    recording = moved(20.0, 6.0, hidden)
    found = fitted("harmonic_drive", recording, drifting_load=True)
    assert found.converged, found.message
    assert max(errors(found, 20.0, INERTIAS).values()) < 4.0
    assert all(found[name].std_dev < 0.2 * found[name].value for name in INERTIAS)
    if hidden:  # what is at stake
        assert fitted("harmonic_drive", recording)["J_q"].value > 1.5 * JOINT["J_q"]


@pytest.mark.long
def test_live_too():
    recording = complete(moved(20.0, 6.0, hidden=3.0))
    joint, found = OnlineIdentifier(build("harmonic_drive", drifting_load=True), ParameterSettings({"N": N})), []
    for k in range(0, len(recording), 50):
        if (estimate := joint.update(recording.slice(k, k + 50))) is not None:
            found.append(estimate)
    converged = [estimate for estimate in found if estimate.converged]
    assert len(converged) > 0.7 * len(found) > 10
    assert max(error for estimate in converged for error in errors(estimate, 20.0, INERTIAS).values()) < 4.0
    assert all(converged[-1][name].std_dev < 0.1 * converged[-1][name].value for name in INERTIAS)


def test_gravity_is_in_the_drifting_load():
    with pytest.raises(JointIdError, match="takes gravity as well"):
        build("harmonic_drive", gravity=True, drifting_load=True)
