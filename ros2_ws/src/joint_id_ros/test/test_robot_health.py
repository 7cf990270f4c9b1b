"""What the driver tells of a robot: the level, the modes by name, what is held back and why."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from joint_id_core.rtde.gate import ALL_ZEROS, NOT_FINITE, NOT_RUNNING
from joint_id_core.rtde.modes import JointMode, RobotMode, SafetyMode
from joint_id_core.rtde.stream import StreamState, StreamStatus
from joint_id_ros.robot_health import RobotHealth

JOINTS = tuple("abcdef")
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def sample(robot=RobotMode.RUNNING, safety=SafetyMode.NORMAL, joint=JointMode.RUNNING, **more):
    return {"timestamp": 1.0, "robot_mode": robot, "safety_mode": safety, "joint_mode": (joint,) * 6, **more}


def status(state=StreamState.STREAMING, error="", age_s=0.002, version=(5, 13, 0, 0), lost=0, reconnects=0):
    return StreamStatus(state, version, 100, lost, reconnects, age_s, error)


@pytest.fixture
def told():
    return []


@pytest.fixture
def health(told):
    return RobotHealth(JOINTS, 500.0, lambda kind, text: told.append((kind, text)))


def test_a_robot_that_runs_is_well(health, told):
    health.note(sample(), "")
    report = health.report(status(lost=3, reconnects=2))
    assert (report.level, report.message) == (OK, "publishing")
    shown = {k: str(v) for k, v in report.values.items()}
    assert shown["connection"] == "streaming"
    assert shown["controller version"] == "5.13.0.0"
    assert shown["rate asked [Hz]"] == "500"
    assert (shown["lost"], shown["reconnects"]) == ("3", "2")
    assert shown["age of the newest sample [s]"] == "0.002"
    assert (shown["robot mode"], shown["safety mode"]) == ("RUNNING", "NORMAL")
    assert [shown[f"{j}: mode"] for j in JOINTS] == ["RUNNING"] * 6
    assert not any("temperature" in key for key in shown)
    assert told == [("mode", "robot mode is RUNNING"), ("mode", "safety mode is NORMAL")]


@pytest.mark.parametrize("state", [StreamState.CONNECTING, StreamState.WAITING, StreamState.STOPPED])
def test_without_a_connection_the_level_is_error_whatever_the_last_sample_said(health, state):
    health.note(sample(), "")
    report = health.report(status(state, "refuses the connection"))
    assert report.level == ERROR
    assert report.message == f"not connected ({state.value}): refuses the connection"


def test_before_the_first_sample_nothing_is_made_up(health):
    report = health.report(status(age_s=math.inf, version=()))
    assert report.level == WARN and "no sample yet" in report.message
    assert report.values["controller version"] == "not known"
    assert "robot mode" not in report.values


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (sample(robot=RobotMode.IDLE), "robot mode is IDLE"),
        (sample(safety=SafetyMode.PROTECTIVE_STOP), "safety mode is PROTECTIVE_STOP"),
        (sample(robot=42), "robot mode is unknown (42)"),
        (
            sample(robot=RobotMode.POWER_OFF, safety=SafetyMode.FAULT),
            "robot mode is POWER_OFF; safety mode is FAULT",
        ),
    ],
)
def test_an_unusual_mode_is_a_warning_with_its_name(health, told, values, text):
    health.note(values, "")
    report = health.report(status())
    assert (report.level, report.message) == (WARN, text)
    assert all(any(part in t for kind, t in told if kind != "mode") for part in text.split("; "))


def test_changes_of_mode_are_told_once_with_what_was_before(health, told):
    for _ in range(3):
        health.note(sample(), "")
    told.clear()
    for _ in range(3):
        health.note(sample(robot=RobotMode.POWER_OFF), f"{NOT_RUNNING}: POWER_OFF")
    for _ in range(3):
        health.note(sample(), "")
    assert told == [
        ("robot mode", "robot mode is POWER_OFF, was RUNNING"),
        ("mode", "robot mode is RUNNING, was POWER_OFF"),
    ]
    assert health.report(status()).values[f"held back: {NOT_RUNNING}: POWER_OFF"] == 3


def test_bad_samples_are_counted_told_once_a_run_and_not_taken_for_modes(health, told):
    health.note(sample(), "")
    told.clear()
    empty = sample(robot=0, safety=0, joint=0)
    for reason in (ALL_ZEROS, ALL_ZEROS, NOT_FINITE, "", ALL_ZEROS, ""):
        health.note(empty if reason else sample(), reason)
    assert [text for _, text in told] == [f"samples held back: {r}" for r in (ALL_ZEROS, NOT_FINITE, ALL_ZEROS)]
    report = health.report(status())
    assert report.level == OK
    assert report.values[f"held back: {ALL_ZEROS}"] == 3
    assert report.values[f"held back: {NOT_FINITE}"] == 1
    assert report.values["robot mode"] == "RUNNING"


def test_joint_modes_and_temperatures_are_given_joint_by_joint(health):
    health.note(sample(joint=JointMode.FAULT, joint_temperatures=(20.0, 21.0, 22.0, 23.0, 24.0, 25.26)), "")
    shown = health.report(status()).values
    assert shown["b: mode"] == "FAULT"
    assert (shown["a: temperature [deg C]"], shown["f: temperature [deg C]"]) == ("20.0", "25.3")
