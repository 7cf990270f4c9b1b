"""Noise, resolution and missing channels; the UR preset against a public log."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.simulation.sensors import UR_CHANNELS, Sensors, ur_robot_sensors

LOG = Path(__file__).resolve().parents[5] / "shared/data/ur3e/wave_currentData_100v_40a.csv"


def still(count=20000, **channels):
    values = channels or {"link_position": 0.3, "current": 1.0}
    time = np.arange(count) * 2e-3
    return Recording(time, {n: np.full(count, v) for n, v in values.items()}, source="test", joint="elbow")


def test_noise_is_white_normal_and_of_the_given_size():
    e = Sensors({"current": 0.2}).measure(still(), seed=1)["current"] - 1.0
    n = e.size
    assert e.std() == pytest.approx(0.2, rel=4 / math.sqrt(2 * n))
    assert abs(e.mean()) < 4 * 0.2 / math.sqrt(n)
    for lag in (1, 2, 10):
        assert abs(np.mean(e[lag:] * e[:-lag])) / 0.04 < 4 / math.sqrt(n)
    assert np.mean(e**4) / 0.2**4 == pytest.approx(3.0, abs=4 * math.sqrt(96 / n))


def test_channels_without_an_entry_pass_untouched_and_channels_do_not_share_noise():
    measured = Sensors({"link_position": 1.0, "current": 1.0}).measure(
        still(voltage=12.0, link_position=0.0, current=0.0)
    )
    np.testing.assert_array_equal(measured["voltage"], 12.0)
    assert abs(np.corrcoef(measured["link_position"], measured["current"])[0, 1]) < 0.03


@given(size=st.floats(1e-6, 10.0), value=st.floats(-100, 100))
def test_readings_lie_on_the_grid_of_the_sensor_within_half_a_step(size, value):
    shown = Sensors(quantum={"link_position": size}).reading("link_position", value, np.random.default_rng(0))
    assert shown / size == pytest.approx(round(shown / size), abs=1e-6)
    assert abs(shown - value) <= 0.5 * size * (1 + 1e-6) + 1e-12


def test_single_readings_have_the_noise_of_the_sensor():
    rng, sensors = np.random.default_rng(2), Sensors({"current": 0.1})
    shown = [sensors.reading("current", 1.0, rng) for _ in range(2000)]
    assert np.std(shown) == pytest.approx(0.1, rel=0.07)
    assert isinstance(shown[0], float)


def test_missing_samples_stay_missing_and_time_source_joint_and_marks_stay():
    r = still(100).with_channels({"link_velocity": np.full(100, np.nan)}, derived=True)
    sensors = Sensors({"link_velocity": 1.0}, {"link_velocity": 0.1})
    measured = sensors.measure(r)
    assert np.isnan(measured["link_velocity"]).all()
    assert measured.derived == {"link_velocity"}
    assert (measured.source, measured.joint) == ("test", "elbow")
    np.testing.assert_array_equal(measured.time, r.time)


def test_only_kept_channels_are_measured_and_keep_the_noise_they_had():
    sensors = Sensors({"link_position": 1.0, "current": 1.0})
    both, one = sensors.measure(still(100), seed=3), sensors.measure(still(100), seed=3, keep=["current"])
    assert set(one.channels) == {"current"}
    np.testing.assert_array_equal(one["current"], both["current"])
    assert not np.array_equal(sensors.measure(still(100), seed=4)["current"], both["current"])


@pytest.mark.parametrize(
    ("noise", "quantum", "message"),
    [
        ({"speed": 1.0}, {}, "unknown channel 'speed'"),
        ({}, {"speed": 1.0}, "unknown channel 'speed'"),
        ({"current": -1.0}, {}, "noise of current = -1.0 A"),
        ({"current": math.inf}, {}, "noise of current = inf A"),
        ({}, {"link_position": 0.0}, "resolution of link_position = 0.0 rad"),
    ],
)
def test_bad_sensors(noise, quantum, message):
    with pytest.raises(JointIdError, match=message):
        Sensors(noise, quantum)


def test_unknown_channels_cannot_be_kept():
    with pytest.raises(JointIdError, match="unknown channel 'speed'"):
        Sensors().measure(still(10), keep=["speed"])


def test_the_ur_preset_scales_the_motor_velocity_with_the_gear_and_names_what_a_robot_sends():
    assert ur_robot_sensors(50.0).noise["motor_velocity"] * 101 == pytest.approx(
        ur_robot_sensors(101.0).noise["motor_velocity"] * 50
    )
    sent = ur_robot_sensors().measure(still(10, motor_position=1.0, link_position=1.0), keep=UR_CHANNELS)
    assert set(sent.channels) == {"link_position"}


@pytest.mark.skipif(not LOG.exists(), reason=f"public UR3e log not at {LOG}")
def test_the_ur_preset_agrees_with_the_public_log():
    lines = [line.split() for line in LOG.read_text().splitlines() if line.strip()]
    table = dict(zip(lines[0], np.array(lines[1:], dtype=float).T, strict=True))
    preset = ur_robot_sensors(1.0)
    steps = np.diff(np.unique(table["actual_q_5"]))
    assert np.median(steps) == pytest.approx(preset.quantum["link_position"], rel=0.02)
    assert np.ptp(steps) < 0.1 * np.median(steps)

    def noise(name):
        """White noise under a motion that is smooth over three samples."""
        return np.std(np.diff(table[name], 2)) / math.sqrt(6)

    at_rest = [0, 3, 4, 5]  # joints that hold still all along
    positions = [noise(f"actual_q_{j}") for j in at_rest]
    assert min(positions) == pytest.approx(preset.noise["link_position"], rel=0.15)
    assert np.median(positions) == pytest.approx(preset.noise["link_position"], rel=0.15)
    currents = [noise(f"actual_current_{j}") for j in at_rest]
    assert np.median(currents) == pytest.approx(preset.noise["current"], rel=0.15)
    fourth = np.diff(table["actual_qd_1"], 4)  # the moving shoulder; the median leaves out the gaps of the log
    spread = np.median(np.abs(fourth)) / 0.6745 / math.sqrt(70)
    assert spread == pytest.approx(preset.noise["motor_velocity"], rel=0.1)
