"""What a Recording promises: strict checks, honest gaps, measured against derived."""

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

TIME = np.array([0.0, 0.1, 0.2, 0.5, 0.6])


def make(**channels):
    return Recording(TIME, {name: np.asarray(values, float) for name, values in channels.items()}, source="log.csv")


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0.0, 0.2, 0.1], r"log: time goes backwards at sample 2 \(0.2 s, then 0.1 s\): sort"),
        ([0.0, 0.2, 0.2], r"log: time repeats at sample 2 \(0.2 s, then 0.2 s\): keep one sample of each time"),
        ([0.0, 0.0, 0.2, 0.2], r"log: time repeats at sample 1 \(0 s, then 0 s\), 2 times in all: keep"),
        ([0.0, 0.0, 0.2, 0.1], r"log: time repeats at sample 1 \(0 s, then 0 s\): sort"),
        ([0.0, np.nan, 0.2], r"log: time of sample 1 is nan"),
        ([[0.0, 0.1]], r"log: time must be one-dimensional"),
    ],
)
def test_time_must_increase(time, message):
    with pytest.raises(JointIdError, match=message):
        Recording(np.array(time), {}, source="log")


def test_channels_are_checked():
    with pytest.raises(JointIdError, match=r"log.csv: unknown channel 'speed': known are motor_position"):
        make(speed=np.zeros(5))
    with pytest.raises(JointIdError, match=r"log.csv: current has shape \(4,\), time has \(5,\)"):
        make(current=np.zeros(4))
    with pytest.raises(JointIdError, match=r"log.csv: current is infinite at sample 2 \(0.2 s\)"):
        make(current=[0, 0, np.inf, 0, 0])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            np.array(["2026-01-01", "2026-01-02"], "datetime64[ns]"),
            "time is not an array of numbers: give floats, time in",
        ),
        (np.array([1, 2], "timedelta64[ms]"), "time is not an array of numbers"),
        ([1.0 + 1.0j, 2.0], "time is not an array of numbers"),
        (["a", "b"], "time is not an array of numbers"),
        ([[1.0], [1.0, 2.0]], "time is not an array of numbers"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused(values, message):
    with pytest.raises(JointIdError, match=rf"log: {message}"):
        Recording(values, {}, source="log")
    with pytest.raises(JointIdError, match=r"log: torque is not an array of numbers"):
        Recording([0.0, 1.0], {"torque": values}, source="log")


@pytest.mark.parametrize("channels", [None, [1.0, 2.0], "torque"])
def test_channels_are_a_dictionary(channels):
    with pytest.raises(JointIdError, match=r"log: channels are of type \w+: give a dictionary"):
        Recording([0.0, 1.0], channels, source="log")


def test_arrays_are_copied_and_may_be_read_only_masked_of_integers_or_of_another_byte_order():
    """Arrays of pandas are read-only, and compiled functions do not take those."""
    time, values = TIME.astype(">f8"), np.ma.masked_array(np.arange(5), mask=[False, True, False, False, False])
    time.setflags(write=False)
    values.setflags(write=False)
    recording = Recording(time, {"current": values})
    for array in (recording.time, recording["current"]):
        assert array.flags.writeable and array.dtype == np.dtype("=f8") and type(array) is np.ndarray
    np.testing.assert_array_equal(recording["current"], [0, np.nan, 2, 3, 4])


def test_gaps_and_missing_values_are_kept():
    recording = make(current=[0, 1, np.nan, 3, 4])
    assert recording.period == pytest.approx(0.1)
    assert recording.gaps == 1
    assert recording.duration == pytest.approx(0.6)
    assert np.isnan(recording["current"][2])
    with pytest.raises(JointIdError, match=r"log.csv has no voltage: it has current"):
        recording["voltage"]


def test_measured_is_neither_derived_nor_empty():
    recording = make(link_position=np.arange(5), current=np.full(5, np.nan))
    recording = recording.with_channels({"link_velocity": np.ones(5)}, derived=True)
    assert [recording.measured(n) for n in ("link_position", "link_velocity", "current")] == [True, False, False]
    assert recording.with_channels({"link_velocity": np.zeros(5)}).measured("link_velocity")


def test_window_is_half_open_and_keeps_the_marks():
    recording = make(link_position=np.arange(5)).with_channels({"link_velocity": np.ones(5)}, derived=True)
    part = recording.window(0.1, 0.5)
    assert part.time.tolist() == [0.1, 0.2]
    assert part["link_position"].tolist() == [1.0, 2.0]
    assert part.derived == {"link_velocity"}
    assert len(recording.window(7.0, 8.0)) == 0
