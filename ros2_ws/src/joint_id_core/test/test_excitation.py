"""Steps and multisines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.errors import JointIdError
from joint_id_core.simulation.excitation import build_multisine, harmonics, multisine, position_reference, step


def test_step_is_zero_before_its_start_and_full_from_then_on():
    np.testing.assert_array_equal(step([0.0, 0.1, 0.2, 0.3], 12.0, 0.2), [0.0, 0.0, 12.0, 12.0])


def spectrum(signal):
    """Amplitudes of a signal sampled over one period, by multiples of 1/period."""
    return 2.0 * np.abs(np.fft.rfft(signal)) / len(signal)


@pytest.mark.parametrize("seed", [None, 4])
def test_multisine_has_its_peak_its_tones_and_nothing_else(seed):
    period, count = 2.0, 4000
    time = np.arange(count) * period / count
    tones = harmonics(0.5, 10.0, period)
    signal = multisine(time, 3.0, tones, seed)
    assert np.abs(signal).max() == pytest.approx(3.0, rel=2e-3)
    lines = spectrum(signal)
    wanted = np.zeros(lines.size, bool)
    wanted[np.round(np.array(tones) * period).astype(int)] = True
    np.testing.assert_allclose(lines[wanted], lines[wanted][0], rtol=1e-9)
    assert lines[~wanted].max() < 1e-12


def test_schroeder_phases_keep_the_peak_lower_than_equal_phases_do():
    tones = harmonics(1.0, 30.0, 1.0)
    signal = multisine(np.arange(2000) / 2000, 1.0, tones)
    crest = np.abs(signal).max() / np.sqrt(np.mean(signal**2))
    assert crest < 2.0  # equal phases: sqrt(2 * 30) = 7.7


def test_position_reference_asks_for_the_same_acceleration_at_every_tone():
    reference = position_reference(amplitude=0.4, low=0.5, high=10.0, period=2.0, seed=3)
    acceleration = np.array(reference.amplitudes) * np.array(reference.frequencies) ** 2
    np.testing.assert_allclose(acceleration, acceleration[0])
    time = np.linspace(0, 2, 4001)
    assert np.abs(reference.value(time)).max() == pytest.approx(0.4, rel=1e-3)
    np.testing.assert_allclose(reference.value(time + 2.0), reference.value(time), atol=1e-12)


@given(time=st.floats(0.0, 100.0), seed=st.integers(0, 1000))
def test_rate_is_the_derivative_of_the_value(time, seed):
    reference = position_reference(seed=seed)
    h = 1e-5
    slope = (reference.value(time + h) - reference.value(time - h)) / (2 * h)
    assert reference.rate(time) == pytest.approx(slope, abs=1e-6 * max(1.0, abs(slope)) + 1e-5)


def test_a_seed_repeats_the_signal_and_another_changes_it():
    tones = harmonics(1.0, 5.0, 1.0)
    assert build_multisine(1.0, tones, 7) == build_multisine(1.0, tones, 7)
    assert build_multisine(1.0, tones, 7) != build_multisine(1.0, tones, 8)


@pytest.mark.parametrize(
    ("amplitude", "tones", "message"),
    [(1.0, [], "one or more"), (1.0, [1.0, -2.0], "positive"), (1.0, [1.0, 1.0], "different"),
     (float("nan"), [1.0], "amplitude = nan")],
)  # fmt: skip
def test_bad_multisines(amplitude, tones, message):
    with pytest.raises(JointIdError, match=message):
        build_multisine(amplitude, tones)


def test_bad_bands():
    with pytest.raises(JointIdError, match="lengthen the period"):
        harmonics(0.6, 0.9, 1.0)
    with pytest.raises(JointIdError, match="low <= high"):
        harmonics(5.0, 1.0, 1.0)
