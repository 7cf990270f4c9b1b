"""Messages and core types hold the same numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import MEASURED_BITS, RAW
from joint_id_core.models import Electromechanical
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status, Verdict
from joint_id_msgs.msg import JointEstimate, JointSamples
from joint_id_msgs.msg import ParameterEstimate as ParameterMessage
from joint_id_ros import conversions as convert

LINKS = RAW[0]


def test_channel_bits_status_and_verdict_codes_are_those_of_the_messages():
    for channel, bit in MEASURED_BITS.items():
        assert getattr(JointSamples, channel.upper()) == bit
    for status in Status:
        assert convert.STATUS_CODES[status] == getattr(JointEstimate, status.name) > 0
    for verdict in Verdict:
        assert convert.VERDICT_CODES[verdict] == getattr(ParameterMessage, verdict.name) > 0


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(instant):
    assert convert.nanoseconds(convert.to_stamp(instant)) == instant


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": []}, "names no joint"),
        ({"name": ["a", "a"], "position": [0.0, 0.0]}, "twice"),
        ({"name": ["a"], "position": [0.0, 1.0]}, "2 values of position for 1 joints"),
        ({"name": ["a"], "effort": [math.inf]}, "effort of joint a is infinite"),
        ({"name": ["a"], "velocity": [-1e300]}, "velocity of joint a is -1e.300, which no joint can have"),
        ({"name": ["a"]}, "holds no values: fill at least one of position, velocity, effort"),
    ],
)
def test_messages_that_make_no_sense_are_refused_with_topic_and_reason(fields, text):
    with pytest.raises(JointIdError, match=f"link_states: .*{text}"):
        convert.check_message(LINKS, JointState(**fields))


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (-(2**31), 0), (1, 10**9), (2**31 - 1, 2**32 - 1)])
def test_a_stamp_that_is_no_time_is_refused(sec, nanosec):
    message = JointState(name=["a"], position=[1.0])
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    with pytest.raises(JointIdError, match=f"link_states: a stamp of {sec} s, {nanosec} ns is no time"):
        convert.check_message(LINKS, message)


def test_an_estimate_and_its_message_say_the_same():
    origin = 5 * 10**18
    estimate = Estimate(
        "rigid_joint", "innovations", Status.POOR_FIT, "look here",
        (ParameterEstimate("J", "kg m^2", 1.5, 0.1, Verdict.ESTIMATED),
         ParameterEstimate("N", "1", 1.0, math.nan, Verdict.FIXED)),
        free=("J",), covariance=np.array([[0.01]]), nrmse={"link_position": 0.02}, noise={"torque": 0.3},
        chi2=1.1, substeps=2, iterations=7, elapsed_s=0.25, start=1.0, end=2.5, samples=750,
    )  # fmt: skip
    m = convert.to_estimate_message("elbow", estimate, None, origin)
    assert (m.joint, m.model, m.estimator, m.message) == ("elbow", "rigid_joint", "innovations", "look here")
    assert m.status == JointEstimate.POOR_FIT
    assert convert.nanoseconds(m.window_start) == origin + 10**9
    assert convert.nanoseconds(m.window_end) == origin + 25 * 10**8
    j, n = m.parameters
    assert (j.name, j.unit, j.value, j.std_dev, j.verdict) == ("J", "kg m^2", 1.5, 0.1, ParameterMessage.ESTIMATED)
    assert math.isnan(n.std_dev) and n.verdict == ParameterMessage.FIXED
    assert list(m.covariance) == [0.01] and list(m.free) == ["J"]
    assert dict(zip(m.signal, m.noise_std, strict=True))["torque"] == 0.3
    assert dict(zip(m.signal, m.nrmse, strict=True))["link_position"] == 0.02
    # Before the first good estimate the parameters are those of the newest fit, and say so.
    assert (m.parameters_status, m.age) == (JointEstimate.POOR_FIT, 0.0)
    assert (m.parameters_start, m.parameters_end) == (m.window_start, m.window_end)
    assert (m.chi2, m.substeps, m.iterations, m.solve_time, m.samples) == (1.1, 2, 7, 0.25, 750)


def test_a_failed_fit_keeps_the_parameters_of_the_last_good_one():
    good = Estimate(
        "rigid_joint", "innovations", Status.CONVERGED, "well",
        (ParameterEstimate("J", "kg m^2", 1.5, 0.1, Verdict.ESTIMATED),),
        free=("J",), covariance=np.array([[0.01]]), start=1.0, end=3.0, samples=1000,
    )  # fmt: skip
    start = ParameterEstimate("J", "kg m^2", 1.0, math.nan, Verdict.NOT_EXCITED)
    failed = Estimate(
        "rigid_joint", "innovations", Status.NO_MOTION, "move it", (start,), start=4.0, end=6.5, samples=9
    )
    m = convert.to_estimate_message("elbow", failed, good, 0)
    assert (m.status, m.message, m.samples) == (JointEstimate.NO_MOTION, "move it", 9)
    assert (m.window_start.sec, m.window_end.sec, m.window_end.nanosec) == (4, 6, 500_000_000)
    assert (m.parameters_status, m.parameters_start.sec, m.parameters_end.sec) == (JointEstimate.CONVERGED, 1, 3)
    assert m.age == 3.5
    assert [(p.value, p.std_dev) for p in m.parameters] == [(1.5, 0.1)]
    assert (list(m.free), list(m.covariance)) == (["J"], [0.01])


def test_changes_are_those_of_the_parameters_with_their_instants():
    changed = ParameterChange("J", 1.5, 0.1, 3.0, 0.2, 12.25)
    good = Estimate("rigid_joint", "innovations", Status.CONVERGED, "well", (), end=13.0, changes=(changed,))
    resting = Estimate("rigid_joint", "innovations", Status.NO_MOTION, "move it", (), start=14.0, end=16.0)
    for m in (convert.to_estimate_message("elbow", e, good, 10**18) for e in (good, resting)):
        (change,) = m.changes
        assert (change.name, change.before, change.before_std_dev) == ("J", 1.5, 0.1)
        assert (change.after, change.after_std_dev) == (3.0, 0.2)
        assert convert.nanoseconds(change.since) == 10**18 + 12_250_000_000
    assert not convert.to_estimate_message("elbow", resting, None, 0).changes


def test_an_estimate_without_data_has_stamps_too():
    estimate = Estimate("rigid_joint", "innovations", Status.TOO_SHORT, "more data", ())
    m = convert.to_estimate_message("elbow", estimate, None, 7 * 10**9)
    assert m.status == JointEstimate.TOO_SHORT and m.window_end.sec == 7


def test_the_truth_holds_every_parameter_as_fixed_without_deviation():
    model = Electromechanical()
    values = model.values({"k_1": 9000.0})
    m = convert.to_truth_message("joint", model, values, 10**9)
    assert {p.name: p.value for p in m.parameters} == values
    assert {p.verdict for p in m.parameters} == {ParameterMessage.FIXED}
    assert {p.std_dev for p in m.parameters} == {0.0}
