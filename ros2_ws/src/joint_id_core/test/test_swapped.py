"""Drive and motion, or motor and link, in each other's columns."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.checking.findings import findings
from joint_id_core.checking.swapped import swapped
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion

from .quick import first_quick

TOLD = "are these two columns swapped? Then exchange them (--map)"
CASES = [("dc_motor", "current"), ("harmonic_drive", "torque")]


def exchanged(recording: Recording, drive: str) -> Recording:
    both = {drive: recording["motor_velocity"], "motor_velocity": recording[drive]}
    return Recording(recording.time, {**recording.channels, **both})


@pytest.mark.parametrize(("model", "drive"), CASES)
@pytest.mark.parametrize("seconds", [2.0, 10.0])
def test_exchanged_columns_are_named(model, drive, seconds):
    motion = simulate_motion(build(model), duration=seconds)
    assert not list(swapped(motion))
    (found,) = swapped(exchanged(motion, drive))
    assert TOLD in found.text and set(found.channels) == {drive, "motor_velocity"}


@pytest.mark.parametrize("gain", [0.1, 1.0])
def test_a_torque_in_the_column_of_the_position_is_named(gain):
    """A large one was told to be a position in degrees, and a small one ended in "try another model"."""
    motion = simulate_motion(build("rigid_joint"), duration=6.0)
    both = {"link_position": gain * motion["torque"], "torque": motion["link_position"]}
    (text, *more) = [f.text for f in findings(Recording(motion.time, both)) if f.fatal]
    assert text.startswith("torque moves as link_position drives it") and TOLD in text and not more


def test_a_motor_in_the_column_of_the_link_is_no_link_in_degrees():
    motion = simulate_motion(build("harmonic_drive"), duration=6.0)
    both = {"link_position": motion["motor_position"], "motor_position": motion["link_position"]}
    texts = " ".join(f.text for f in findings(Recording(motion.time, {**motion.channels, **both})))
    assert "exchange the columns of motor and link" in texts and "degrees" not in texts


@pytest.mark.parametrize("values", first_quick([{}, {"R": 0.7, "k_t": 0.045, "c_b": 4e-4}]))
def test_the_message_of_a_fit_says_so(values):
    """With the second motor the fit converges, to a voltage constant that is 5,000 times the torque constant."""
    motion = simulate_motion(build("dc_motor"), duration=2.0, values=values)
    assert TOLD in fit(build("dc_motor"), exchanged(motion, "current")).message
    assert TOLD in findings(exchanged(motion, "current"))[0].text, "it explains the others"
    assert TOLD not in fit(build("dc_motor"), motion).message


@pytest.mark.parametrize(
    "model", first_quick(["dc_motor", "harmonic_drive", "motor_side", "electromechanical", "rigid_joint"], 2)
)
def test_no_recording_with_the_right_columns_is_doubted(model):
    for seconds in (1.0, 6.0):
        assert TOLD not in " ".join(f.text for f in findings(simulate_motion(build(model), duration=seconds)))


def test_a_current_that_holds_a_weight_is_no_velocity():
    """The current then changes as the velocity says, but the position does not move as the current says."""
    time = np.arange(5000) / 500.0
    w = 2.0 * np.pi * np.geomspace(0.2, 4.0, 8)
    at = np.outer(time, w) + np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, len(w))
    q, velocity = np.sin(at) @ (0.1 / w), np.cos(at).sum(axis=1) * 0.1
    held = {"motor_velocity": 100.0 * velocity, "current": 8.0 * np.sin(q)}
    assert list(swapped(Recording(time, held))), "nothing shows it without a position"
    assert not list(swapped(Recording(time, {**held, "link_position": q})))


def test_short_constant_or_missing_signals_tell_nothing():
    motion = exchanged(simulate_motion(build("dc_motor"), duration=4.0), "current")
    still, gone = np.zeros(len(motion)), np.full(len(motion), np.nan)
    for other in (still, gone):
        for name in ("current", "motor_velocity"):
            assert not list(swapped(Recording(motion.time, {**motion.channels, name: other})))
    assert list(swapped(Recording(motion.time, {**motion.channels, "link_position": gone})))
    short = Recording(motion.time[:200], {n: v[:200] for n, v in motion.channels.items()})
    assert not list(swapped(short))
    holes = {n: np.where(np.arange(len(motion)) % 40 < 5, np.nan, v) for n, v in motion.channels.items()}
    assert list(swapped(Recording(motion.time, holes)))


def test_exchanged_columns_of_motor_and_link_are_refused():
    time, motor, link = np.arange(0.0, 4.0, 0.002), "motor_position", "link_position"
    turned = 0.3 * np.sin(3.0 * time) + 0.1 * np.sin(7.0 * time)
    assert not [f for f in findings(Recording(time, {motor: 101.0 * turned, link: turned})) if "exchange" in f.text]
    assert not [f for f in findings(Recording(time, {motor: turned, link: turned})) if "exchange" in f.text]  # no gear
    (found,) = (f for f in findings(Recording(time, {motor: turned, link: 101.0 * turned})) if "exchange" in f.text)
    assert "motor_position turns 0.0099 times as far as link_position" in found.text and found.fatal
    assert "exchange the columns of motor and link (--map), or mend their units" in found.text


@pytest.mark.parametrize("beside", [[], ["link_position"]])
def test_exchanged_velocities_of_motor_and_link_are_refused(beside):
    """A motor as slow as a link seemed to stand, and a gear that twists hid that the link is as fast as a motor."""
    motion = simulate_motion(build("electromechanical"), duration=4.0)
    motor, link = "motor_velocity", np.gradient(motion["link_position"], motion.time)
    link = np.convolve(link, np.full(5, 0.2), "same")
    shown = {name: motion[name] for name in ("voltage", *beside)}
    right = Recording(motion.time, {**shown, motor: motion[motor], "link_velocity": link})
    assert not [f for f in findings(right) if f.fatal]
    (found,) = (f for f in findings(Recording(right.time, {**shown, motor: link, "link_velocity": motion[motor]})))
    assert "motor_velocity turns 0.0099 times as far as link_velocity" in found.text and found.fatal
