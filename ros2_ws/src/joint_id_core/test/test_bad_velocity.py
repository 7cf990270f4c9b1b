"""A link's velocity that is worse than the derivative of its position, where a model takes both as inputs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from joint_id_core.checking.velocity import CONTRADICTS, velocities
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

MODEL, TRUTH = build("motor_side"), build("harmonic_drive").values()
SHOWN = ("J_m", "c_m", "tau_fm", "c_1", "k_1")
DERIVED = "this fit derives link_velocity from the position"


@cache
def moved() -> Recording:
    """Four seconds of both sides of a gear, with the velocity of the link as exact as a good sensor's."""
    sensors = Sensors(noise={"link_position": 1e-5, "link_velocity": 1e-3, "motor_velocity": 0.1})
    shown = simulate_closed_loop(
        build("harmonic_drive"), PositionController(), position_reference(), np.arange(2000) / 500,
        torque_noise=0.003, seed=2, sensors=sensors,
    )  # fmt: skip
    names = ("link_position", "link_velocity", "motor_velocity", "torque")
    return Recording(shown.time, {name: shown[name] for name in names}, source="both sides")


def with_velocity(change: Callable[[Array], Array]) -> Recording:
    return moved().with_channels({"link_velocity": change(moved()["link_velocity"])})


def noisy(share: float) -> Callable[[Array], Array]:
    return lambda v: v + share * np.std(v) * np.random.default_rng(0).standard_normal(len(v))


def of_another_joint(v: Array) -> Array:
    return v + np.std(v) * np.sin(2.0 * np.pi * moved().time)


FAULTS = {
    "a factor": (lambda v: 1.1 * v, "is 1.1 times the derivative of link_position"),
    "late": (lambda v: np.roll(v, 2), "is late by 4 ms"),
    "of another joint": (of_another_joint, "is not the derivative of link_position, which explains"),
    "noise": (noisy(0.03), "is more than that of the derivative of link_position"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_it_is_told_and_the_fit_is_that_of_the_position(fault):
    """A factor of 1.1 made c_m 2.7 times as large, 4 ms k_1 9 % too small, `converged`, at sigmas of 0.5 %."""
    change, said = FAULTS[fault]
    found = fit(MODEL, with_velocity(change))
    channels = {name: values for name, values in moved().channels.items() if name != "link_velocity"}
    alone = fit(MODEL, Recording(moved().time, channels, source="both sides"))
    assert found.status is Status.CONVERGED
    assert any(said in note and DERIVED in note for note in found.notes), found.notes
    for name in SHOWN:
        assert found[name].value == pytest.approx(alone[name].value, rel=1e-9)
        assert abs(found[name].value - TRUTH[name]) < 4.0 * found[name].std_dev


def test_a_good_one_is_used():
    assert not any("derives" in note for note in fit(MODEL, moved()).notes)


@pytest.mark.parametrize("fault", ["a factor", "of another joint"])
def test_online_such_a_window_is_refused(fault):
    """Nothing derives a velocity there, and values were hundreds of standard deviations off, `converged`."""
    found = live(with_velocity(FAULTS[fault][0]))
    assert {one.status for one in found} == {Status.BAD_DATA}
    assert all("link_velocity is" in one.message and "derivative of link_position" in one.message for one in found)


def test_online_a_velocity_of_zeros_is_refused():
    found = live(with_velocity(np.zeros_like))
    assert {one.status for one in found} == {Status.BAD_DATA}
    assert all("link_velocity is 0 in all samples while link_position changes" in one.message for one in found)


def live(recording: Recording):
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=1.0, hop_s=0.5))
    parts = (recording.slice(k, k + 250) for k in range(0, len(recording), 250))
    found = [one for one in map(identifier.update, parts) if one is not None and one.status is not Status.TOO_SHORT]
    assert found
    return found


@pytest.mark.parametrize("noise", [0.0, 1e-5, 3e-3])
def test_noise_of_a_position_is_no_contradiction(noise):
    """At 3 mrad it hides most of the motion."""
    time = np.arange(4000) / 500
    angle = 0.01 * np.sin(2.0 * np.pi * time)
    shown = angle + noise * np.random.default_rng(0).standard_normal(len(time))
    recording = Recording(time, {"link_position": shown, "link_velocity": np.gradient(angle, time)})
    assert not [one for one in velocities(recording) if one.about == CONTRADICTS]
