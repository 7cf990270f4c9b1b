"""Motors of all sizes under a voltage, alone and behind a gear, without any start value."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from joint_id_core import ParameterSettings, fit
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.regression_starts import started
from joint_id_core.models import Model, build
from joint_id_core.results.estimate import Estimate
from joint_id_core.simulation.simulator import JointSimulator

from .quick import first_quick

MOTOR, JOINT = build("dc_motor"), build("electromechanical")
STEP_S, MOVE_S = 0.3, 1.0
NOISE = {"current": 0.002, "motor_velocity": 3e-4}  # over stall current and idle speed
SETTINGS = ("L", "J_r", "J_m", "J_q", "c_b", "N")  # that the user knows

# Volts, and true values in SI units: the table's motor has k_t = 0.055, R = 0.49
MOTORS = {
    "small": (14.0, {"R": 3.6, "L": 3e-3, "k_b": 3.3e-3, "k_t": 3.4e-3, "J_r": 2e-7, "tau_fc": 5e-4, "c_b": 2e-7}),
    "fast": (32.0, {"R": 0.093, "L": 3e-5, "k_b": 0.0101, "k_t": 0.0102, "J_r": 2.5e-5, "tau_fc": 0.14, "c_b": 6e-5}),
    "large": (48.0, {"R": 0.3, "L": 1.5e-3, "k_b": 1.4, "k_t": 1.3, "J_r": 0.06, "tau_fc": 6.0, "c_b": 0.02}),
}  # fmt: skip
SMALL = {
    "R": 7.9, "L": 0.021, "k_b": 0.0143, "k_t": 0.0146, "J_m": 1.3e-6, "c_m": 7.2e-7, "tau_fm": 1.5e-3, "k_1": 12.9,
    "k_2": 513.0, "c_1": 0.0117, "J_q": 0.0195, "c_q": 0.0178, "N": 80.0, "c_b": 0.0,
}  # fmt: skip
LARGE = {
    "R": 0.37, "L": 4e-4, "k_b": 0.2, "k_t": 0.2, "J_m": 2e-3, "c_m": 2e-3, "tau_fm": 2.0, "k_1": 3e5, "k_2": 1e12,
    "c_1": 100.0, "J_q": 15.0, "c_q": 10.0, "N": 100.0, "c_b": 0.0,
}  # fmt: skip


def steps(volts: float) -> Callable[[float], float]:
    levels = volts * np.random.default_rng(3).uniform(-1.0, 1.0, 100)
    return lambda t: float(levels[int(t / STEP_S + 1e-9)])


def pulses(volts: float) -> Callable[[float], float]:
    """Moves with rests between them."""
    return lambda t: volts * np.sin(np.pi * t / MOVE_S) ** 2 * (-1.0) ** int(t / MOVE_S) * (t % MOVE_S < 0.8 * MOVE_S)


def moved(
    model: Model, values: Mapping[str, float], volts: float, voltage: Callable[[float], float], rate: float = 1000.0,
    encoder: float = 2e-5,
) -> Recording:  # fmt: skip
    """What sensors show of a motor, and of a link if there is one, with an encoder of this resolution in rad."""
    joint, rng = JointSimulator(model, model.values(values)), np.random.default_rng(1)
    time, rows = np.arange(round(4.0 * rate)) / rate, []
    for t in time.tolist():
        rows.append({"voltage": voltage(t), **joint.state})
        joint.advance(1.0 / rate, {"voltage": voltage(t) + 2e-4 * volts * rng.standard_normal()})
    shown = {n: np.array([row[n] for row in rows]) for n in ("voltage", "current", "motor_velocity")}
    for name, size in (("current", volts / values["R"]), ("motor_velocity", volts / values["k_b"])):
        shown[name] = shown[name] + NOISE[name] * size * rng.standard_normal(len(time))
    if "link_position" in model.state_names:
        shown["link_position"] = encoder * np.round([row["link_position"] / encoder for row in rows])
    return Recording(time, shown, source="moved")


def found(model: Model, values: Mapping[str, float], recording: Recording) -> Estimate:
    return fit(model, recording, ParameterSettings({n: values[n] for n in SETTINGS if n in values}))


def assert_right(estimate: Estimate, values: Mapping[str, float]) -> None:
    assert estimate.converged, estimate.message
    for name in estimate.free:
        row = estimate[name]
        assert abs(row.value - values[name]) < 4.0 * row.std_dev, f"{name} {row.value:g} +- {row.std_dev:g}"


@pytest.mark.parametrize("size", first_quick(MOTORS))
def test_a_motor_of_any_size_is_found_without_a_start(size):
    volts, values = MOTORS[size]
    estimate = found(MOTOR, values, moved(MOTOR, values, volts, steps(volts)))
    assert_right(estimate, values)
    assert estimate["k_t"].std_dev < 0.02 * values["k_t"]


def test_a_joint_much_smaller_than_the_table_is_found_without_a_start():
    assert_right(found(JOINT, SMALL, moved(JOINT, SMALL, 32.0, pulses(16.0), 500.0)), SMALL)


@pytest.mark.long
def test_a_spring_that_stiffens_as_real_ones_do_is_found_without_a_start():
    """Table III of the paper has a cubic stiffness of a 2000th of that of Table V."""
    estimate = found(JOINT, LARGE, moved(JOINT, LARGE, 48.0, steps(48.0)))
    assert_right(estimate, LARGE)
    assert estimate["k_2"].std_dev < 0.1 * LARGE["k_2"]


def test_what_the_user_has_set_is_no_start_of_a_regression():
    volts, values = MOTORS["small"]
    own = ParameterSettings({"R": 2.0, "k_b": 1e-3})
    settings = started(MOTOR, moved(MOTOR, values, volts, steps(volts)), own)
    assert settings.values["R"] == 2.0 and settings.values["k_b"] == 1e-3
    settings = started(JOINT, moved(JOINT, SMALL, 32.0, pulses(16.0), 500.0), ParameterSettings({"k_b": 0.05}))
    assert settings.values["k_b"] == 0.05 and settings.values["R"] == pytest.approx(SMALL["R"], rel=0.1)
