"""Estimates and what is written of them say the same, and rclpy reads what is written."""

import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message

from joint_id_core.online.drift import Drift
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status, Verdict
from joint_id_msgs.msg import JointEstimate, JointParams
from joint_id_msgs.msg import ParameterEstimate as ParameterMessage
from joint_id_ros.conversions import nanoseconds
from joint_id_ros.estimate_bytes import DRIFT_TEXT, VERDICT, ParamsWriter, by_field, to_values
from joint_id_ros.message_types import message_class

FUZZ = settings(deadline=None, max_examples=60, derandomize=True, suppress_health_check=list(HealthCheck))
LIMITS = {"uint8": (0, 2**8 - 1), "uint16": (0, 2**16 - 1), "uint32": (0, 2**32 - 1), "int32": (-(2**31), 2**31 - 1)}
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)


def written(kind):
    """Values of any message of a type, as they are written."""
    parts = []
    for name in kind.get_fields_and_field_types().values():
        element = name.removeprefix("sequence<").removesuffix(">")
        if element == "double":
            part = st.floats()
        elif element == "string":
            part = TEXTS
        elif element in LIMITS:
            part = st.integers(*LIMITS[element])
        else:
            part = written(message_class(element.replace("/", "/msg/")))
        parts.append(st.lists(part, max_size=3) if element != name else part)
    return st.tuples(*parts)


def held(message):
    """The same values of a message object."""
    if hasattr(message, "get_fields_and_field_types"):
        return tuple(held(getattr(message, name)) for name in message.get_fields_and_field_types())
    return message if isinstance(message, str | int | float) else [held(element) for element in message]


def read(estimates):
    """Write values and read them again."""
    return deserialize_message(ParamsWriter().write(estimates), JointParams)


def test_all_that_is_written_is_read_again():
    writer = ParamsWriter()  # one for all: what it has learnt from one message must not spoil the next one

    @FUZZ
    @given(st.lists(st.tuples(written(JointEstimate), written(JointEstimate)), max_size=3), st.data())
    def look(pairs, data):
        for estimates in zip(*pairs, strict=True):
            message = deserialize_message(writer.write(dict(zip("cab", estimates, strict=False))), JointParams)
            found = dict(zip("cab", estimates, strict=False))
            assert repr([held(joint) for joint in message.joints]) == repr([found[name] for name in sorted(found)])
            stamp = max((joint.window_end for joint in message.joints), key=nanoseconds, default=None)
            assert message.header.frame_id == "" and stamp in (None, message.header.stamp)

    look()


def test_numbers_that_change_alone_are_written_at_their_places():
    writer = ParamsWriter()

    @FUZZ
    @given(st.lists(st.floats(), min_size=4, max_size=4), st.integers(0, 10**12), st.sampled_from(["", "a", "abcde"]))
    def look(numbers, instant, text):
        a, b, c, d = numbers
        values = to_values("elbow", estimate(message=text, chi2=a, temperature=b, covariance=np.array([[c]]),
                                             nrmse={"torque": d}, end=instant * 1e-9), None, 0)  # fmt: skip
        joints = deserialize_message(writer.write({"elbow": values, "wrist": values}), JointParams).joints
        for m in joints:
            assert repr([m.chi2, m.temperature, *m.covariance, *m.nrmse]) == repr([a, b, c, d])
            assert m.message == text and nanoseconds(m.window_end) == instant

    look()


def estimate(**changes):
    """An estimate that did not fit."""
    known = {
        "model": "rigid_joint", "estimator": "innovations", "status": Status.POOR_FIT, "message": "look here",
        "parameters": (ParameterEstimate("J", "kg m^2", 1.5, 0.1, Verdict.ESTIMATED),
                       ParameterEstimate("N", "1", 1.0, math.nan, Verdict.FIXED)),
        "free": ("J",), "covariance": np.array([[0.01]]), "nrmse": {"link_position": 0.02}, "noise": {"torque": 0.3},
        "chi2": 1.1, "substeps": 2, "iterations": 7, "elapsed_s": 0.25, "start": 1.0, "end": 2.5, "samples": 750,
    }  # fmt: skip
    return Estimate(**known | changes)


def message_of(joint, newest, good, origin_ns, drifts=()):
    """The message of the estimates of one joint."""
    (message,) = read({joint: to_values(joint, newest, good, origin_ns, drifts)}).joints
    return message


def test_while_two_estimators_disagree_the_parameters_are_the_newest_with_their_wide_intervals():
    good = estimate(status=Status.CONVERGED)
    wide = estimate(status=Status.DISAGREE, parameters=(ParameterEstimate("J", "kg m^2", 1.6, 0.8, Verdict.PRIOR),))
    m = message_of("elbow", wide, good, 0)
    assert m.status == m.parameters_status == JointEstimate.DISAGREE
    assert [(p.value, p.std_dev) for p in m.parameters] == [(1.6, 0.8)]
    assert message_of("elbow", estimate(), good, 0).parameters_status == JointEstimate.CONVERGED


def test_an_estimate_and_its_message_say_the_same():
    origin = 10**18
    m = message_of("elbow", estimate(), None, origin)
    assert (m.joint, m.model, m.estimator, m.message) == ("elbow", "rigid_joint", "innovations", "look here")
    assert m.status == JointEstimate.POOR_FIT
    assert nanoseconds(m.window_start) == origin + 10**9
    assert nanoseconds(m.window_end) == origin + 25 * 10**8
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
    m = message_of("elbow", failed, good, 0)
    assert (m.status, m.message, m.samples) == (JointEstimate.NO_MOTION, "move it", 9)
    assert (m.window_start.sec, m.window_end.sec, m.window_end.nanosec) == (4, 6, 500_000_000)
    assert (m.parameters_status, m.parameters_start.sec, m.parameters_end.sec) == (JointEstimate.CONVERGED, 1, 3)
    assert m.age == 3.5
    assert [(p.value, p.std_dev) for p in m.parameters] == [(1.5, 0.1)]
    assert (list(m.free), list(m.covariance)) == (["J"], [0.01])


def test_changes_are_those_of_the_parameters_with_their_instants():
    changed = ParameterChange("J", 1.5, 0.1, 3.0, 0.2, 12.25)
    unsure = ParameterChange("c", 1.5, 0.1, 3.0, 0.2, 12.5, sure=False)
    good = Estimate("rigid_joint", "innovations", Status.CONVERGED, "well", (), end=13.0, changes=(changed, unsure))
    resting = Estimate("rigid_joint", "innovations", Status.NO_MOTION, "move it", (), start=14.0, end=16.0)
    for m in (message_of("elbow", e, good, 10**18) for e in (good, resting)):
        (change,) = m.changes
        assert (change.name, change.before, change.before_std_dev) == ("J", 1.5, 0.1)
        assert (change.after, change.after_std_dev) == (3.0, 0.2)
        assert nanoseconds(change.since) == 10**18 + 12_250_000_000
    assert not message_of("elbow", resting, None, 0).changes


def test_an_estimate_without_data_has_stamps_too():
    estimate = Estimate("rigid_joint", "innovations", Status.TOO_SHORT, "more data", ())
    m = message_of("elbow", estimate, None, 7 * 10**9)
    assert m.status == JointEstimate.TOO_SHORT and m.window_end.sec == 7


def test_drifts_come_with_the_estimate():
    drift = Drift("J", "kg m^2", 1.0, 1.5, 0.1, 0.999, 12.25, 20.25, 5.0)
    (d,) = message_of("elbow", estimate(), None, 10**18, [drift]).drifts
    assert (d.name, d.unit, d.baseline, d.value, d.std_dev) == ("J", "kg m^2", 1.0, 1.5, 0.1)
    assert (d.confidence, d.temperature_change, d.text) == (0.999, 5.0, drift.text)
    assert nanoseconds(d.since) == 10**18 + 12_250_000_000


def test_the_stamp_is_the_newest_end_of_a_window_and_joints_are_sorted():
    ends = {"wrist": 3.0, "elbow": 4.5}
    message = read({joint: to_values(joint, estimate(end=end), None, 0) for joint, end in ends.items()})
    assert [m.joint for m in message.joints] == ["elbow", "wrist"]
    assert nanoseconds(message.header.stamp) == 4_500_000_000
    assert not read({}).joints


def test_values_by_field_are_those_of_the_message():
    values = to_values("elbow", estimate(), estimate(), 0)
    (message,) = read({"elbow": values}).joints
    fields = by_field(values)
    assert (fields["joint"], fields["message"], fields["status"]) == ("elbow", message.message, message.status)
    assert [row[VERDICT] for row in fields["parameters"]] == [row.verdict for row in message.parameters]
    drift = Drift("J", "kg m^2", 1.0, 1.5, 0.1, 0.99, 0.0, 1.0, math.nan)
    (row,) = by_field(to_values("elbow", estimate(), None, 0, [drift]))["drifts"]
    assert row[DRIFT_TEXT] == drift.text
