"""Joints of all sizes, from the servo of a gripper to the axis of an industrial robot, without any start value."""

import numpy as np
import pytest

from joint_id_core import ParameterSettings, fit
from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators.regression_starts import started
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

# J in kg m^2, and torques over the rms torque of the inertia
SIZES = {"gripper": 2e-4, "small": 2e-3, "cobot": 0.3, "industrial": 30.0}
SHARE = {"tau_f": 1.5, "tau_0": 0.4, "a_g": 4.0, "b_g": -1.0}
ENCODER = 2.0 * np.pi / 2**17  # rad


def moved(J, gravity, seed=1):
    """True values, and position and torque of a joint that moves, with noise of 1 % of the torque."""
    rate, time = 250.0, np.arange(3000) / 250.0
    reference = position_reference(0.6)
    inertia = J * np.std(np.gradient([reference.rate(t) for t in time], 1.0 / rate))
    torques = {name: share * inertia for name, share in SHARE.items() if gravity or not name.endswith("_g")}
    model = build("rigid_joint", gravity=gravity)
    truth = model.values({"J": J, "c": 0.5 * inertia, **torques})
    sensors = Sensors(noise={"torque": 0.01 * inertia}, quantum={"link_position": ENCODER})
    recording = simulate_closed_loop(model, controller_of(model, truth), reference, time, truth)
    shown = sensors.measure(Recording(time, {n: recording[n] for n in ("link_position", "torque")}), seed=seed)
    return model, truth, shown


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize("size", SIZES)
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
    model, _, recording = moved(SIZES["small"], gravity=True)
    assert not started(model, recording, None).priors


def test_what_the_user_says_of_a_prior_stays():
    model, _, recording = moved(SIZES["industrial"], gravity=True)
    own = ParameterSettings(values={"J": 1.0}, priors={"a_g": 3.0})
    settings = started(model, recording, own)
    assert settings.values["J"] == 1.0 and settings.priors["a_g"] == 3.0 and "a_g" not in settings.values
