"""Intervals know what steps and smooth friction do to estimates: the truth is from adaptive integrators."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators import Innovations, fit
from joint_id_core.estimators.innovations import checks, sharpness
from joint_id_core.estimators.innovations.gauss_newton import Cost
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import position_reference

MODEL = build("rigid_joint")
TRUTH = MODEL.values()
RATE, SECONDS = 125.0, 2.0  # few samples, each reversal within one of them
POSITION, TORQUE = 2e-5, 1e-3  # noise of a UR robot's sensors, rad and Nm


@functools.cache
def exact() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and torques of a joint with the friction of the model that a controller moves."""
    time = np.arange(round(RATE * SECONDS) + 1) / RATE
    reference, controller = position_reference(), controller_of(MODEL, TRUTH)
    wanted, rate = reference.value(time), reference.rate(time)
    positions, torques, state = [], [], np.array([wanted[0], 0.0])

    def slope(_: float, x: np.ndarray, torque: float) -> list[float]:
        friction = TRUTH["c"] * x[1] + TRUTH["tau_f"] * math.tanh(x[1] / TRUTH["w_s"]) + TRUTH["tau_0"]
        return [x[1], (torque - friction) / TRUTH["J"]]

    for q, dq in zip(wanted.tolist(), rate.tolist(), strict=True):
        torque = controller.k_p * (q - state[0]) + controller.k_d * (dq - state[1])
        positions.append(state[0])
        torques.append(torque)
        solution = solve_ivp(slope, (0.0, 1.0 / RATE), state, "DOP853", args=(torque,), rtol=1e-11, atol=1e-13)
        state = solution.y[:, -1]
    return time, np.array(positions), np.array(torques)


def record(seed: int, noise: float) -> Recording:
    """What sensors show that have `noise` times that of a UR robot."""
    time, position, torque = exact()
    white = noise * np.random.default_rng(seed).standard_normal((2, len(time)))
    channels = {"link_position": position + POSITION * white[0], "torque": torque + TORQUE * white[1]}
    return Recording(time, channels, source="smooth")


def scores(estimates) -> np.ndarray:
    """Errors over standard deviations, a row an estimate."""
    return np.array([[(e[n].value - TRUTH[n]) / e[n].std_dev for n in e.free] for e in estimates])


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.1, *(pytest.param(n, marks=pytest.mark.long) for n in (1.0, 0.01))])
def test_intervals_hold_the_truth_whether_noise_or_the_integrator_decides(noise):
    found = scores([fit(MODEL, record(seed, noise)) for seed in range(24)])
    assert np.mean(np.abs(found) < 1.96) > 0.85  # 0.95, less three standard deviations of 24 records
    assert np.abs(found).max() < 5.0


@pytest.mark.long
def test_steps_that_are_chosen_find_what_the_finest_find():
    """One step a sample is off by more than a standard deviation, though reversals of friction get more."""
    for seed in range(3):
        few, chosen, finest = (
            fit(MODEL, record(seed, 1.0), estimator=Innovations(substeps=steps)) for steps in (1, 0, 64)
        )
        for name in chosen.free:
            assert abs(chosen[name].value - finest[name].value) < 0.1 * finest[name].std_dev, name
        assert abs(few["J"].value - finest["J"].value) > finest["J"].std_dev


def sticking(seed: int, rate: float = RATE) -> Recording:
    """The same motion of a joint that sticks where it turns."""
    motion = simulate_motion(MODEL, SECONDS, rate, noise=False)
    white = np.random.default_rng(seed).standard_normal((2, len(motion.time)))
    channels = {
        "link_position": motion["link_position"] + POSITION * white[0], "torque": motion["torque"] + TORQUE * white[1]
    }  # fmt: skip
    return Recording(motion.time, channels, source="sticking")


def without(monkeypatch, record_of, seeds):
    """Estimates with the bias of smoothed friction in their intervals, and without it; of the estimator by itself."""
    known = [Innovations().fit(MODEL, record_of(seed)) for seed in seeds]
    monkeypatch.setattr(checks, "smoothing_bias", lambda stages, found: np.zeros_like(found.hessian))
    return known, [Innovations().fit(MODEL, record_of(seed)) for seed in seeds]


def test_the_interval_of_a_joint_that_sticks_contains_the_bias_of_smooth_friction(monkeypatch):
    """It moves the estimates of all records alike, those of J by more than they say."""
    known, unknown = without(monkeypatch, sticking, range(24))
    z, z_without = scores(known), scores(unknown)
    J = known[0].free.index("J")
    assert abs(np.mean(z_without[:, J])) > 1.0  # by chance of 24 records at most 0.6
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.2  # not much wider than that asks for


def test_the_interval_of_a_joint_with_the_friction_of_the_model_does_not_grow(monkeypatch):
    """The data tell that sharper friction would describe them less well."""
    known, unknown = without(monkeypatch, lambda seed: record(seed, 1.0), range(12))
    grown = [a[n].std_dev / b[n].std_dev for a, b in zip(known, unknown, strict=True) for n in a.free]
    assert np.quantile(grown, 0.8) < 1.05


@pytest.mark.parametrize("rounded", [False, True])
def test_where_noise_is_rounding_the_likelihood_does_not_rule_out_that_the_joint_sticks(monkeypatch, rounded):
    """A rounded position repeats itself while a joint sticks, which speaks for friction that lets it creep."""
    monkeypatch.setattr(sharpness, "expit", lambda _: 0.0)  # as it was for a joint whose damping was 11 sigma off
    shown = sticking(0, 2000.0)
    if rounded:
        shown = shown.with_channels({"link_position": 1e-4 * np.round(shown["link_position"] / 1e-4)})
    (known,), (unknown,) = without(monkeypatch, lambda _: shown, [0])
    grown = known["J"].std_dev / unknown["J"].std_dev
    assert grown > 1.05 if rounded else grown == 1.0


@pytest.mark.parametrize("paths", [1, 2, 4])
def test_where_the_path_with_sharper_friction_diverges_another_one_is_tried(monkeypatch, paths):
    """Damping was six standard deviations off where the bias was left out for that."""
    calls = iter(range(100))

    class Diverging(Cost):
        def at(self, *args):
            return None if next(calls) < paths else super().at(*args)

    shown = sticking(0)
    usual = Innovations().fit(MODEL, shown)["J"].std_dev
    monkeypatch.setattr(sharpness, "Cost", Diverging)
    tried = Innovations().fit(MODEL, shown)["J"].std_dev
    _, (unknown,) = without(monkeypatch, lambda _: shown, [0])
    assert unknown["J"].std_dev < 0.8 * usual
    assert tried == unknown["J"].std_dev if paths == 4 else tried == pytest.approx(usual, rel=0.3)
