"""Tables with columns of several joints: which column is which channel of which joint."""

import re

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core import formats
from joint_id_core.errors import JointIdError
from joint_id_core.formats.joint_columns import understood

TIME = np.arange(5) * 0.01


@pytest.mark.parametrize(
    ("column", "joint", "channel"),
    [
        ("q1", "joint_1", "link_position"),
        ("dq_7", "joint_7", "link_velocity"),
        ("q_dot_2", "joint_2", "link_velocity"),
        ("tau_J1", "joint_1", "torque"),
        ("J1 torque (Nm)", "joint_1", "torque"),
        ("joint_position_0", "joint_0", "link_position"),
        ("position[3]", "joint_3", "link_position"),
        ("/joint_states/effort[3]", "joint_3", "torque"),
        ("motor_velocity_2", "joint_2", "motor_velocity"),
        ("external_torque_4", "joint_4", "external_torque"),
        ("actual_current_5", "joint_5", "current"),
        ("target_current_5", "joint_5", "target_current"),
        ("q_desired_1", "joint_1", "reference_position"),
        ("arm_1_joint_position", "arm_1_joint", "link_position"),
        ("- arm_1_joint_effort", "arm_1_joint", "torque"),
        ("/joint_states/elbow_joint/velocity", "elbow_joint", "link_velocity"),
        ("elbow.position", "elbow", "link_position"),
        ("jointPosition1", "joint_1", "link_position"),
        ("qDot3", "joint_3", "link_velocity"),
        ("msrJntPos_2", "joint_2", "link_position"),
        ("DQ4", "joint_4", "link_velocity"),
        ("elbowTorque", "elbow", "torque"),
        ("Velocity", "", "link_velocity"),
        ("Motor Voltage (V)", "", "voltage"),
        ("motor_speed_2", "joint_2", "motor_velocity"),
        ("Motor angle", "", "motor_position"),
    ],
)
def test_names_that_people_write(column, joint, channel):
    assert understood(column) == (joint, channel, column)


@pytest.mark.parametrize(
    "column",
    [
        "tau_J_d1", "q_d1", "tau_ext_hat_filtered_1", "torque_filtered_1", "tau_gravity_elbow", "k_1", "time",
        "dq_desired_1", "elbow_model_torque", "ddq_1", "robot0_position_2",
    ],
)  # fmt: skip
def test_what_is_no_measurement_of_a_joint_is_left_alone(column):
    found = understood(column)
    assert found is None or found[1] not in ("link_position", "link_velocity", "torque", "current")


def test_units_are_converted():
    assert understood("Axis 3 angle [deg]") == ("joint_3", "link_position", f"{np.pi / 180!r}*Axis 3 angle [deg]")
    assert understood("motor_current_1 (mA)") == ("joint_1", "current", "0.001*motor_current_1 (mA)")
    assert understood("q_1 (Nm)") is None


@given(
    words=st.sampled_from(
        [("q{}", "dq{}", "tau{}"), ("pos_{}", "vel_{}", "trq_{}"), ("J{} angle", "J{} speed", "J{} torque")]
    ),
    first=st.integers(0, 1),
    count=st.integers(1, 7),
    separator=st.sampled_from([",", ";", "\t"]),
    seed=st.integers(0, 10**6),
)
def test_every_joint_reads_back(tmp_path_factory, words, first, count, separator, seed):
    values = np.random.default_rng(seed).normal(size=(3, count, len(TIME)))
    numbers = range(first, first + count)
    names = ["t", *(word.format(k) for word in words for k in numbers)]
    rows = zip(TIME.tolist(), *values.reshape(-1, len(TIME)).tolist(), strict=True)
    path = tmp_path_factory.mktemp("table") / "log.csv"
    path.write_text("\n".join(separator.join(row) for row in [names, *(map(repr, row) for row in rows)]) + "\n")
    assert formats.joints(path) == tuple(f"joint_{k}" for k in numbers)
    for k, name in enumerate(formats.joints(path)):
        recording = formats.read(path, name)
        assert recording.joint == name
        for channel, own in zip(("link_position", "link_velocity", "torque"), values, strict=True):
            np.testing.assert_array_equal(recording[channel], own[k])


def table(tmp_path, *names):
    path = tmp_path / "log.csv"
    rows = [",".join(repr(float(10 * k + row)) for k in range(len(names))) for row in range(5)]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


def test_joints_with_names(tmp_path):
    path = table(
        tmp_path, "__time", "base_joint_position", "base_joint_effort", "elbow_position", "elbow_effort", "rate"
    )
    assert formats.joints(path) == ("base_joint", "elbow")
    assert formats.read(path, "elbow")["torque"][0] == 40.0
    assert formats.taken(path) == [
        "link_position = base_joint_position, elbow_position", "torque = base_joint_effort, elbow_effort",
    ]  # fmt: skip
    with pytest.raises(JointIdError, match="the joints base_joint, elbow: choose one of them"):
        formats.read(path)


def test_one_joint_with_a_name(tmp_path):
    path = table(tmp_path, "t", "elbow_position", "elbow_torque")
    assert formats.joints(path) == ("elbow",)
    recording = formats.read(path)
    assert (recording["link_position"][0], recording["torque"][0]) == (10.0, 20.0)
    mixed = table(tmp_path, "t", "elbow_position", "elbow_torque", "torque")  # of whom the last one is, is not clear
    assert formats.joints(mixed) == ()


def test_a_table_of_one_joint_may_have_short_words(tmp_path):
    path = table(tmp_path, "time", "q", "dq", "tau")
    assert formats.joints(path) == ()
    recording = formats.read(path)
    assert {n: float(v[0]) for n, v in recording.channels.items()} == {
        "link_position": 10.0, "link_velocity": 20.0, "torque": 30.0,
    }  # fmt: skip
    clear = table(tmp_path, "time", "q", "angle", "torque")  # which of both is not clear
    assert "link_position" not in formats.read(clear)


def test_a_column_that_is_there_twice_is_named(tmp_path):
    path = table(tmp_path, "time", "position", "position", "effort", "effort_2")
    with pytest.raises(JointIdError, match="two columns are called 'position': rename one"):
        formats.read(path)
    assert formats.read(path, mapping={"link_position": "effort_2"}).measured("torque")


def test_matrices_of_a_mat_file(tmp_path):
    path, q = tmp_path / "log.mat", np.arange(10.0).reshape(5, 2)
    scipy.io.savemat(path, {"t": TIME, "q": q, "tau": -q, "tau_g": 0.0 * q})
    assert formats.joints(path) == ("joint_1", "joint_2")
    np.testing.assert_array_equal(formats.read(path, "joint_2")["torque"], -q[:, 1])
    assert formats.taken(path, "joint_2") == ["time_s = t", "link_position = q.2", "torque = tau.2"]
    assert formats.unread(path) == ["tau_g.1", "tau_g.2"]


def test_what_no_joint_reads_is_left_alone_and_said(tmp_path, run):
    code, out, _ = run("info", table(tmp_path, "time", "q1", "tau1", "q2", "tau2", "tau_gravity_2", "n"))
    assert code == 0 and "not understood and left alone (name them with --map): tau_gravity_2, n" in out
    code, out, err = run("info", table(tmp_path, "time", "position", "effort"))
    assert code == 0 and "link_position = position" in out and "left alone" not in out + err


def test_a_mapping_names_columns_of_every_joint(tmp_path):
    path = table(tmp_path, "stamp", "enc_1_se", "enc_2_se", "m_1", "m_2", "m_g")
    mapping = {"time_s": "0.001*stamp", "link_position": "0.5*enc_#_se", "torque": "m_#"}
    assert formats.joints(path, mapping) == ("joint_1", "joint_2")
    recording = formats.read(path, "joint_2", mapping)
    assert recording["link_position"][0] == 10.0 and recording["torque"][0] == 40.0
    assert recording.time[1] == 0.001


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"link_position": "angle_#"}, "link_position=angle_#: no column is called so with a number for #"),
        (
            {"link_position": "q#", "torque": "tau#"},
            "q# has columns of the joints 1, 2, torque=tau# of 1: they must be",
        ),
    ],
)
def test_mappings_that_do_not_fit(tmp_path, mapping, message):
    path = table(tmp_path, "time", "q1", "q2", "tau1")
    with pytest.raises(JointIdError, match=re.escape(message)):
        formats.joints(path, mapping)


def test_two_columns_for_one_channel_of_a_joint_are_refused(tmp_path):
    path = table(tmp_path, "time", "q1", "position_1", "tau1")
    with pytest.raises(JointIdError, match="'q1' and 'position_1' could both be link_position of joint_1"):
        formats.joints(path)


def test_a_mapping_of_channels_makes_one_joint(tmp_path):
    path = table(tmp_path, "time", "q1", "q2", "tau1", "tau2")
    mapping = {"link_position": "q2", "torque": "tau2"}
    assert formats.joints(path, mapping) == ()
    assert formats.read(path, None, mapping)["torque"][0] == 40.0


def test_columns_of_other_joints_are_no_typing_errors(tmp_path, caplog):
    path = table(tmp_path, "time", "q1", "q2", "torque1", "torque2")
    formats.read(path, "joint_1")
    assert "did you mean" not in caplog.text
