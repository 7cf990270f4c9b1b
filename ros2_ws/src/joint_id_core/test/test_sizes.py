"""Joints of all sizes, from the servo of a gripper to the axis of an industrial robot, without any start value."""

import numpy as np
import pytest

from joint_id_core import ParameterSettings, fit
from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators.regression_starts import started
from joint_id_core.filtering.offline import complete
from joint_id_core.models import build
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .quick import first_quick

# J in kg m^2, and torques over the rms torque of the inertia
SIZES = {"gripper": 2e-4, "small": 2e-3, "cobot": 0.3, "industrial": 30.0}
SHARE = {"tau_f": 1.5, "tau_0": 0.4, "a_g": 4.0, "b_g": -1.0}
ENCODER = 2.0 * np.pi / 2**17  # rad


def moved(J, gravity, seed=1, amplitude=0.6):
    """True values, and position and torque of a joint that moves so many rad, with noise of 1 % of the torque."""
    rate, time = 250.0, np.arange(3000) / 250.0
    reference = position_reference(amplitude)
    inertia = J * np.std(np.gradient([reference.rate(t) for t in time], 1.0 / rate))
    torques = {name: share * inertia for name, share in SHARE.items() if gravity or not name.endswith("_g")}
    model = build("rigid_joint", gravity=gravity)
    truth = model.values({"J": J, "c": 0.5 * inertia, **torques})
    sensors = Sensors(noise={"torque": 0.01 * inertia}, quantum={"link_position": ENCODER})
    recording = simulate_closed_loop(model, controller_of(model, truth), reference, time, truth)
    shown = sensors.measure(Recording(time, {n: recording[n] for n in ("link_position", "torque")}), seed=seed)
    return model, truth, shown


@pytest.mark.parametrize("size", first_quick(SIZES))
def test_online_a_joint_of_any_size_is_known_after_a_window_and_stays_known(size):
    model, truth, recording = moved(SIZES[size], gravity=True)
    joint, found = OnlineIdentifier(model), []
    samples = complete(recording)
    for k in range(0, len(samples), 25):
        if (estimate := joint.update(samples.slice(k, k + 25))) is not None:
            found.append(estimate)
    assert len(found) > 15 and all(estimate.converged for estimate in found)
    for estimate in found:
        assert estimate["J"].std_dev < 0.002 * truth["J"] and estimate["a_g"].std_dev < 0.01 * truth["a_g"]
        for name in estimate.free:
            assert abs(estimate[name].value - truth[name]) < 4.0 * estimate[name].std_dev, name


@pytest.mark.long
@pytest.mark.parametrize("size", first_quick(["industrial", "gripper"]))
def test_several_recordings_of_a_joint_of_any_size_are_one(size):
    model, truth, first = moved(SIZES[size], gravity=True)
    _, _, second = moved(SIZES[size], gravity=True, seed=2)
    estimate = fit(model, [first, second])
    assert estimate.converged, estimate.message
    for name in ("J", "c", "tau_f", "a_g", "b_g"):
        assert abs(estimate[name].value - truth[name]) < 4.0 * estimate[name].std_dev, name
    assert estimate["a_g"].std_dev < 0.01 * abs(truth["a_g"])


@pytest.mark.parametrize("gravity", first_quick([True, False]))
@pytest.mark.parametrize("size", first_quick(SIZES))
def test_a_joint_of_any_size_is_found_without_a_start(size, gravity):
    model, truth, recording = moved(SIZES[size], gravity)
    estimate = fit(model, recording)
    assert estimate.converged, estimate.message
    for name in estimate.free:
        found = estimate[name]
        assert abs(found.value - truth[name]) < 4.0 * found.std_dev, f"{name} {found.value:g} +- {found.std_dev:g}"
    assert estimate["J"].std_dev < 0.02 * truth["J"] and estimate["tau_f"].std_dev < 0.05 * truth["tau_f"]


def test_torques_beyond_a_prior_get_room_together_and_others_keep_the_table():
    model, truth, recording = moved(SIZES["industrial"], gravity=True)
    settings = started(model, recording, None)
    assert settings.priors.keys() == {"tau_0", "a_g", "b_g"}  # the first and the last could not balance each other else
    assert min(settings.priors.values()) > 0.8 * abs(truth["a_g"])
    model, _, recording = moved(SIZES["gripper"], gravity=True)
    narrow = started(model, recording, None).priors
    assert narrow.keys() == settings.priors.keys()
    assert 10.0 * SHARE["a_g"] * truth["tau_0"] > max(narrow.values()) > 5.0 * np.max(np.abs(recording["torque"]))


@pytest.mark.parametrize("amplitude", first_quick([0.1, 0.03, 0.01]))
def test_gravity_and_offset_that_a_small_angle_cannot_part_are_no_start_values(amplitude):
    """A regression finds them a million times too large, one against the other, with intervals to match."""
    model, truth, recording = moved(100.0, True, amplitude=amplitude)
    settings = started(model, recording, None)
    largest = 10.0 * np.max(np.abs(recording["torque"]))
    assert all(abs(settings.values.get(name, 0.0)) <= largest for name in ("tau_0", "a_g", "b_g"))
    estimate = fit(model, recording)
    for name in estimate.free if estimate.converged else ():
        assert abs(estimate[name].value - truth[name]) < 4.0 * estimate[name].std_dev, name


def test_what_the_user_says_of_a_prior_stays():
    model, _, recording = moved(SIZES["industrial"], gravity=True)
    own = ParameterSettings(values={"J": 1.0}, priors={"a_g": 3.0})
    settings = started(model, recording, own)
    assert settings.values["J"] == 1.0 and settings.priors["a_g"] == 3.0 and "a_g" not in settings.values


TORQUES = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq")
MEASURED = {
    "motor_side": ("link_position", "motor_velocity", "torque"),
    "harmonic_drive": ("link_position", "motor_velocity", "motor_position", "torque", "external_torque"),
}


@pytest.mark.parametrize("factor", first_quick([300.0, 0.003, 1.0]))
@pytest.mark.parametrize("name", MEASURED)
def test_a_flexible_joint_whose_torques_are_all_larger_or_smaller_is_found_with_the_same_relative_errors(name, factor):
    usual = build("harmonic_drive").values()
    truth = {n: factor * v if n in TORQUES else v for n, v in usual.items()}
    default, time = PositionController(), np.arange(3000) / 500.0
    controller = PositionController(default.k_p * factor, default.k_d * factor, np.inf)
    sensors = Sensors(noise={"link_position": 1e-5, "motor_velocity": 0.1, "motor_position": 1e-3})
    moved = simulate_closed_loop(
        build("harmonic_drive"), controller, position_reference(), time, truth,
        torque_noise=0.003 * factor, seed=1, sensors=sensors,
    )  # fmt: skip
    estimate = fit(build(name), Recording(time, {n: moved[n] for n in MEASURED[name]}))
    assert estimate.converged, estimate.message
    for found in (estimate[n] for n in estimate.free if n in TORQUES):
        assert abs(found.value - truth[found.name]) < 4.0 * found.std_dev < 0.1 * truth[found.name], found
