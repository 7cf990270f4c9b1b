"""Coarse signals, velocities that froze at zero, and samples that come many at a time are named for what they are."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.checking.findings import findings
from joint_id_core.checking.signals import highest_frequency
from joint_id_core.data.recording import Recording

from .faulty_recordings import good


@pytest.mark.parametrize(
    ("name", "step", "said"),
    [
        ("link_position", 0.01, "Channel link_position goes in steps of 0.01 rad"),
        ("link_velocity", 0.05, "Channel link_velocity goes in steps of 0.05 rad/s"),
        ("torque", 1.0, "Channel torque goes in steps of 1 Nm"),
    ],
)
def test_a_signal_of_few_steps_is_named_and_not_taken_for_a_fast_motion(name, step, said):
    recording = good()
    coarse = recording.with_channels({name: np.round(recording[name] / step) * step})
    texts = [f.text for f in findings(coarse)]
    assert any(text.startswith(said) for text in texts), texts
    assert not any("samples/s are few" in text for text in texts)


def test_commands_in_equal_steps_and_fine_encoders_are_not_coarse():
    recording = good()
    stairs = np.floor(recording.time / 0.05) % 20
    fine = np.round(recording["link_position"] / 1e-4) * 1e-4
    other = recording.with_channels({"torque": stairs, "link_position": fine, "reference_position": np.round(fine, 1)})
    assert not [f for f in findings(other) if "goes in steps of" in f.text]


def test_a_velocity_that_is_zero_between_motions_in_both_directions_is_named():
    recording = good()
    still = recording["link_velocity"].copy()
    turn = int(np.flatnonzero(np.diff(np.sign(still)))[2])
    still[turn - 60 : turn + 60] = 0.0
    texts = [f.text for f in findings(recording.with_channels({"link_velocity": still}))]
    assert any(f"link_velocity stands still in samples {turn - 60} to {turn + 59}" in text for text in texts), texts


@pytest.mark.parametrize("step", [1e-6, 1e-4])
def test_samples_that_come_many_at_a_time_are_named_and_not_taken_for_a_high_rate(step):
    recording = good()
    burst = np.arange(len(recording)) % 5
    times = recording.time - 0.002 * burst + step * burst
    texts = [f.text for f in findings(Recording(times, recording.channels))]
    assert any(text.startswith("Samples come many at a time") for text in texts), texts
    assert not any("samples/s are few" in text for text in texts)


def test_a_spectrum_needs_little_memory_for_long_recordings_and_bursts():
    """The steps of time are a microsecond within a burst: even instants as close would be 10^10 in a day."""
    time = 10.0 * (np.arange(50_000) // 5) + 1e-6 * (np.arange(50_000) % 5)
    assert highest_frequency(time, np.sin(2.0 * np.pi * 0.003 * time), 1) == pytest.approx(0.003, rel=0.1)
    long = np.arange(600_000) / 500.0
    values = np.where(long > 600.0, 1.0, 1e-3) * np.sin(2.0 * np.pi * 3.0 * long)
    assert highest_frequency(long, values, 1) == pytest.approx(3.0, abs=0.1)


def test_rounding_of_an_encoder_is_no_fast_motion():
    """Single lines of its spectrum stand above the median: a motion of 1 Hz was told to have parts at 222 Hz."""
    time = np.arange(4000) / 500.0
    angle = 0.3 * np.sin(2.0 * np.pi * 0.8 * time) + 0.05 * np.sin(2.0 * np.pi * 2.1 * time)
    for step in (0.001, 0.002, 0.005, 0.01):
        assert highest_frequency(time, np.round(angle / step) * step, 1) == pytest.approx(2.1, abs=0.4), step
