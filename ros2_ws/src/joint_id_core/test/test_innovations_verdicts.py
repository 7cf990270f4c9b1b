"""What the innovations estimator says of parameters and data, and what it refuses."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.verdicts import MAGNITUDE
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .innovation_records import RIGID, RIGID_TRUTH, closed_loop, errors, rigid


def test_samples_without_an_input_are_left_out_and_counted():
    recording = rigid()
    torque = recording["torque"].copy()
    torque[200:204] = np.nan
    estimate = fit(RIGID, recording.with_channels({"torque": torque}))
    assert estimate.status is Status.CONVERGED
    assert "4 samples without an input were left out." in estimate.notes
    assert estimate.samples == len(recording) - 4
    assert all(abs(z) < 4.0 for z in errors(estimate, RIGID_TRUTH).values())


def test_fixed_and_freed_parameters():
    held = fit(RIGID, rigid(), ParameterSettings({"tau_f": 2.0}, fixed=("tau_f",)))
    assert held.free == ("J", "c", "tau_0")
    assert (held["tau_f"].value, held["tau_f"].verdict) == (2.0, Verdict.FIXED)
    assert np.isnan(held["tau_f"].std_dev)
    assert held.covariance.shape == (3, 3)
    assert held["c"].std_dev < fit(RIGID, rigid())["c"].std_dev
    freed = fit(RIGID, rigid(), ParameterSettings({"J": 1.7, "N": 0.7}, fixed=("J",), freed=("N",)))
    assert "N" in freed.free
    assert abs(freed["N"].value - 1.0) < 4.0 * freed["N"].std_dev < 0.1


def test_a_positive_parameter_stays_positive():
    """Without friction its level goes towards zero, never below."""
    time = np.arange(900) / 300
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1), seed=5)
    truth = {"J": 1.7, "c": 3.0, "tau_f": 0.0, "tau_0": 0.0}
    motion = simulate(RIGID, time, {"torque": torque + 0.05 * np.random.default_rng(1).standard_normal(900)}, truth)
    motion = Sensors(noise={"link_position": 1e-5}).measure(motion, 1, keep=("link_position",))
    estimate = fit(RIGID, motion.with_channels({"torque": torque}))
    assert 0.0 < estimate["tau_f"].value < 0.1


def test_an_estimate_stops_at_its_bound_and_says_so(monkeypatch):
    """A table that allows J only up to 1.5, where the data say 1.7."""
    measured, rows = rigid(), tuple(replace(p, upper=1.5) if p.name == "J" else p for p in RIGID.parameters)
    monkeypatch.setattr(type(RIGID), "parameters", property(lambda self: rows))
    estimate = fit(RIGID, measured)
    assert estimate["J"].value == pytest.approx(1.5, rel=1e-12)
    assert estimate["J"].verdict is Verdict.AT_BOUND
    assert estimate["c"].verdict is Verdict.ESTIMATED


def test_what_the_motion_does_not_show_is_named():
    """One way at a steady speed: friction and damping cannot be told apart, inertia hardly shows."""
    time = np.arange(1000) / 500
    torque = np.full(1000, 5.0) + 0.01 * np.sin(3.0 * time)
    truth = {"J": 1.0, "c": 3.0, "tau_f": 2.0, "tau_0": 0.0}
    motion = simulate(RIGID, time, {"torque": torque}, truth, x0={"link_velocity": 1.0})
    measured = Sensors(noise={"link_position": 1e-4}).measure(motion, 0, keep=("link_position", "torque"))
    estimate = fit(RIGID, measured)
    unseen = {p.name for p in estimate.parameters if p.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)}
    assert {"tau_f", "tau_0"} & unseen
    for name in unseen:
        assert name in next(note for note in estimate.notes if "does not show" in note)
    for name in unseen:
        row, value = RIGID.parameter(name), estimate[name].value
        known = min(0.5 * row.spread, MAGNITUDE) * value if row.positive else 0.5 * row.spread
        assert estimate[name].std_dev > known
    bounds = re.search("it lies (?:between (.*) and|below about) (.*) Nm", estimate["c"].reason).groups()
    assert float(bounds[0] or 0.0) < truth["c"] < float(bounds[1])


def test_a_drive_that_does_not_cause_the_motion_is_a_poor_fit():
    """A torque of another joint fits no inertia, however much noise it is granted."""
    motion = closed_loop(1)
    other = np.random.default_rng(3).standard_normal(1000)
    estimate = fit(
        RIGID,
        Recording(motion.time, {"link_position": motion["link_position"], "torque": other}),
        ParameterSettings({"N": 101.0}),
    )
    assert estimate.status is Status.POOR_FIT
    assert "does not cause this motion" in estimate.message
    assert "do not trust the standard deviations" in estimate.message


def test_a_small_load_is_no_reason_for_a_poor_fit():
    """Noise of the torque that is larger than it, but much smaller than the torque itself."""
    motion = rigid()
    load = motion.with_channels({"external_torque": 1e-4 * np.sin(motion.time)})
    estimate = fit(RIGID, load)
    assert estimate.converged and not any("does not cause" in note for note in estimate.notes)


@pytest.mark.parametrize(
    ("change", "status", "says"),
    [
        (lambda r: r.slice(0, 20), Status.TOO_SHORT, "20 samples"),
        (lambda r: r.slice(0, 0), Status.TOO_SHORT, "0 samples"),
        (lambda r: r.with_channels({"link_position": np.full(900, 0.3)}), Status.NO_MOTION, "did not change"),
        (lambda r: Recording(r.time, {"torque": r["torque"]}), Status.MISSING_SIGNAL, "measures none of the states"),
        (
            lambda r: Recording(r.time, {"link_position": r["link_position"]}),
            Status.MISSING_SIGNAL, "has no torque, an input of model rigid_joint",
        ),
        (lambda r: r.with_channels({"torque": np.full(900, np.nan)}), Status.MISSING_SIGNAL, "has no torque"),
        (
            lambda r: r.with_channels({"torque": np.where(np.arange(900) < 870, np.nan, r["torque"])}),
            Status.TOO_SHORT, "only 30 samples have all inputs (torque, external_torque)",
        ),
        (
            lambda r: r.with_channels({"link_position": np.full(900, np.nan)}),
            Status.MISSING_SIGNAL, "measures none of the states",
        ),
    ],
)  # fmt: skip
def test_data_that_cannot_be_fitted_are_a_status(change, status, says):
    estimate = fit(RIGID, change(rigid()))
    assert estimate.status is status
    assert says in estimate.message
    assert "\n" not in estimate.message
    assert all(np.isnan(p.std_dev) for p in estimate.parameters)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"values": {"k_9": 1.0}}, "model rigid_joint has no parameter 'k_9'"),
        ({"values": {"J": -1.0}}, r"parameter J = -1 kg m\^2 is outside its bounds"),
        ({"values": {"J": float("nan")}}, "parameter J = nan: must be a finite number"),
        ({"fixed": ("k_9",)}, "no parameter 'k_9'"),
        ({"freed": ("k_9",)}, "no parameter 'k_9'"),
        ({"values": {"tau_f": 0.0}}, "parameter tau_f starts at 0.*--fix tau_f=0"),
        ({"fixed": ("J", "c", "tau_f", "tau_0")}, "every parameter is fixed"),
        ({"fixed": "J"}, r"fixed = 'J': give a list of names"),
    ],
)
def test_misuse_is_an_error_of_one_line(arguments, says):
    with pytest.raises(JointIdError, match=says) as error:
        fit(RIGID, rigid(), ParameterSettings(**arguments))
    assert "\n" not in str(error.value)
