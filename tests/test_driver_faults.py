"""Node `driver` while things go wrong with the robot: what is lost, that it goes on, and that it says so."""

import itertools
import math

import pytest
from robot_messages import NANO, PERIOD_NS
from robot_stream import WAITS, Reader, assert_only_held_back
from sensor_msgs.msg import JointState

HOST = "127.0.0.1"
RATE = 500
STALL_S = 5.0  # a busy machine may hold up the emulator for longer than the 0.5 s of the default
OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


def stamps(links):
    return [m.header.stamp.sec * NANO + m.header.stamp.nanosec for m in links]


class Course:
    """A robot, its driver, and what is published."""

    def __init__(self, start, probe, machine):
        self.probe, self.machine = probe, machine
        self.links = probe.collect(JointState, "link_states")
        self.motors = probe.collect(JointState, "motor_states")
        self.process = start("driver", robot_ip=HOST, port=machine.port, stall_s=STALL_S)
        self.go_on()

    def go_on(self, seconds=0.5):
        """Wait for samples of some time, counted from now."""
        count = len(self.links) + seconds * RATE
        self.probe.until(lambda: len(self.links) > count, "samples")

    def told(self, text, level):
        """Wait for a report, made from now on, that says this and is at least as bad as this; return its values."""
        self.probe.diagnostics.clear()
        self.probe.until(lambda: self.probe.told("driver", text), f"a report with {text!r}")
        status = self.probe.told("driver", text)
        assert status.level >= level
        return {v.key: v.value for v in status.values}

    def well(self):
        """Wait for a report, made from now on, that all is well; return its values."""
        return self.told("publishing", OK)


@pytest.fixture
def course(start, probe, robot):
    return Course(start, probe, robot())


def test_bad_samples_are_left_out_and_all_others_published(course):
    reader = Reader(course.machine.port, ("actual_q", "actual_current"))
    course.go_on()
    begin = len(course.links) - 1
    course.machine.tell("drop 3")
    values = course.told("lost", WARN)
    assert values["lost"] == "3"
    course.machine.tell("zero 2")
    course.told("all zeros", WARN)
    course.machine.tell("nan 4")
    course.told("not finite", WARN)
    course.machine.tell("fragment on")
    course.go_on()
    course.machine.tell("fragment off")
    course.go_on()
    values = course.well()
    assert values["lost"] == "3"
    assert (values["held back: all zeros"], values["held back: not finite"]) == ("2", "4")
    assert values["reconnects"] == "0"
    reader.close()

    published = [(*m.position, *m.effort) for m in course.links]
    true = [s[1:] for s in reader.samples if s[0] != 0.0 and not any(map(math.isnan, s))]
    held = int(values.get(WAITS, 0))  # where the machine held up the first samples, and the clock was set
    assert_only_held_back(published[begin:], true, held)
    periods = [round((b - a) / PERIOD_NS) for a, b in itertools.pairwise(stamps(course.links)[begin:])]
    assert held or sorted(p for p in periods if p != 1) == [3, 4, 5]  # 2 zero, 3 dropped, 4 NaN
    left = stamps(course.links)[begin:]
    right = [s for s in stamps(course.motors) if s >= left[0]]
    both = min(len(left), len(right))  # one of the topics may be read a bit further
    assert both > 2 * RATE and left[:both] == right[:both]


def test_modes_are_told_and_only_a_robot_without_power_is_not_published(course):
    course.machine.tell("protective-stop")
    values = course.told("PROTECTIVE_STOP", WARN)
    assert values["safety mode"] == "PROTECTIVE_STOP" and values["robot mode"] == "RUNNING"
    course.go_on()  # a robot that stands still is measured as well
    course.machine.tell("unlock")
    course.well()
    course.machine.tell("power-off")
    values = course.told("POWER_OFF", WARN)
    assert values["elbow_joint: mode"] == "POWER_OFF"
    told = course.probe.get_clock().now().nanoseconds
    course.probe.spin(1.0)  # what is under way, however late, was stamped before, but for how far stamps may be ahead
    assert stamps(course.links)[-1] < told + NANO // 5
    course.machine.tell("power-on")
    course.go_on()
    values = course.well()
    assert int(values["held back: robot not running: POWER_OFF"]) > RATE
    assert values["lost"] == values["reconnects"] == "0"
    for text in ("POWER_OFF", "PROTECTIVE_STOP"):
        assert text in course.process.text


def test_a_clock_that_jumps_is_followed_once_and_stamps_go_on(course):
    for jump in (5.0, -5.0):
        course.machine.tell(f"clock-jump {jump}")
        course.told("clock", WARN)
        course.go_on()
    values = course.well()
    steps = [b - a for a, b in itertools.pairwise(stamps(course.links))]
    assert min(steps) > 0
    assert max(steps) < 4 * NANO  # the jumps of 5 s are not in the stamps
    assert sum(abs(step - PERIOD_NS) > PERIOD_NS // 10 for step in steps) <= int(values["problems: clock set"])


def test_a_stream_that_ends_comes_back(course):
    faults = [
        ("stall 8", "no sample for 5 s", ERROR),
        ("kill", "ended the connection", WARN),  # the next connection may be there before the report
        ("garbage 64", "not RTDE", WARN),
        ("power-cycle 2.5", "refuses the connection", ERROR),
    ]
    for k, (fault, text, level) in enumerate(faults):
        course.machine.tell(fault)
        course.told(text, level)
        course.go_on()
        values = course.well()
        assert values["reconnects"] == str(k + 1)
        assert (values["robot mode"], values["lost"]) == ("RUNNING", "0")
    steps = [b - a for a, b in itertools.pairwise(stamps(course.links))]
    assert min(steps) > 0
    assert "Traceback" not in course.process.text
