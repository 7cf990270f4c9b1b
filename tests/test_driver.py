"""Node `driver` on an emulated robot: every sample, unchanged, in SI units; and a clear word where that cannot be."""

import itertools
import re
import signal
import socket
import struct
from pathlib import Path

import pytest
from robot_messages import NANO, PERIOD_NS, RATIO
from robot_stream import WAITS, Connection, Reader, Wire, assert_only_held_back
from sensor_msgs.msg import JointState

import joint_id_core.rtde
import joint_id_ros
from joint_id_core.rtde.fields import PORT
from joint_id_msgs.msg import RobotSignals

HOST = "127.0.0.1"
RATE = 500
MOTOR_POSITIONS = [f"output_double_register_{k}" for k in range(24, 30)]
DRIVER_MODULES = ("nodes/driver.py", "options/driver.py", "robot_signals.py", "robot_health.py")
PAUSE_S = 20.0  # a busy machine may hold up the emulator for longer than the 0.5 s that count as a stall by default
STEER = 200e-6  # by which stamps may run faster or slower than the robot's clock, to stay with the system's
ROUNDING_NS = 2
AHEAD_NS = 200_000_000  # more than the stamps of a robot may be ahead of the system's clock


def nanoseconds(message):
    return message.header.stamp.sec * NANO + message.header.stamp.nanosec


def measured(messages):
    """Positions and currents of each message, by which a sample is known: at a turn, positions alone may repeat."""
    return [(*m.position, *m.effort) for m in messages]


def assert_steady(messages, period_ns=PERIOD_NS, shifts=0):
    """Every stamp one period after the one before, but for as often as the driver said that it set the clock."""
    steps = [b - a for a, b in itertools.pairwise(map(nanoseconds, messages))]
    assert min(steps) > 0
    assert sum(abs(step - period_ns) > STEER * period_ns + ROUNDING_NS for step in steps) <= shifts


def report_from_now_on(probe):
    """Values of a report made from now on: one that arrives next may have been under way."""
    for _ in range(2):
        probe.diagnostics.clear()
        probe.until(lambda: probe.told("driver", "publishing"), "a report from now on")
    return {v.key: v.value for v in probe.told("driver", "publishing").values}


def clock_shifts(report):
    """How often the driver has found that a clock was set: where the first samples came late it does."""
    return int(report.get("problems: clock set", 0))


def numbers_of(reader, links, held):
    """Numbers of the reader's samples that were published: all from the first on, but for those held back."""
    return assert_only_held_back(measured(links), [sample[1:13] for sample in reader.samples], held)


@pytest.mark.parametrize("seconds", [5, pytest.param(20, marks=pytest.mark.long)])
def test_samples_at_500_hz_are_published_without_a_loss_and_unchanged(start, probe, robot, seconds):
    machine = robot()
    links = probe.collect(JointState, "link_states")
    motors = probe.collect(JointState, "motor_states")
    extra = probe.collect(RobotSignals, "robot_signals")
    reader = Reader(
        machine.port, ("actual_q", "actual_current", "actual_qd", "joint_temperatures", "target_qdd", *MOTOR_POSITIONS)
    )
    before = probe.get_clock().now().nanoseconds
    start(
        "driver",
        robot_ip=HOST,
        port=machine.port,
        motor_position_source="output_double_register_24..29",
        extra_fields=["joint_temperatures", "target_qdd"],
        stall_s=PAUSE_S,
    )
    probe.until(lambda: len(links) > (seconds + 1) * RATE, f"{seconds} s of samples")
    # The three topics were found one after the other: compare from the instant from which all three came.
    first = max(nanoseconds(topic[0]) for topic in (links, motors, extra))
    links, motors, extra = ([m for m in topic if nanoseconds(m) >= first] for topic in (links, motors, extra))
    after = probe.get_clock().now().nanoseconds  # samples still come
    report = report_from_now_on(probe)  # which tells of all these samples
    reader.close()
    held = int(report.get(WAITS, 0))
    numbers = numbers_of(reader, links, held)
    rows = list(zip((reader.samples[k] for k in numbers), links, motors, extra, strict=False))
    assert len(rows) >= seconds * RATE
    for sample, link, motor, more in rows:
        assert sample[1:7] == tuple(link.position)
        assert [RATIO * v for v in sample[13:19]] == list(motor.velocity)
        assert sample[7:13] == tuple(link.effort)
        assert sample[19:25] == tuple(more.joint_temperatures)
        assert sample[25:31] == tuple(more.target_qdd)
        assert sample[31:37] == tuple(motor.position)
        assert link.header == motor.header == more.header
        assert link.name == motor.name == more.name
    assert_steady([link for _, link, _, _ in rows], shifts=clock_shifts(report) + held)
    assert before < first < nanoseconds(rows[-1][1]) < after

    assert report["lost"] == report["reconnects"] == "0"
    assert report["controller version"].startswith("5.13.0")
    assert report["rate asked [Hz]"] == "500"
    assert (report["robot mode"], report["safety mode"]) == ("RUNNING", "NORMAL")
    assert report["elbow_joint: mode"] == "RUNNING"
    assert 20.0 < float(report["elbow_joint: temperature [deg C]"]) < 40.0
    # Where the machine held up the first samples, the clock is set, and a sample is held back until its stamp is right.
    problems = {key for key in report if key.startswith("problems: ")}
    assert problems <= {"problems: clock set", "problems: samples held back"}


@pytest.mark.long
def test_two_drivers_get_every_sample_whatever_other_clients_do_and_however_packets_are_cut(start, probe, robot):
    machine = robot()
    writer = Connection(machine.port)
    registers = [f"input_double_register_{k}" for k in range(24, 30)]
    recipe = writer.ask(b"I", ",".join(registers).encode())[:1]
    assert writer.ask(b"S") == b"\x01"
    writer.send(b"U", recipe + struct.pack(">6d", *range(24, 30)))
    machine.tell("fragment on")
    reader = Reader(machine.port, ("actual_q", "actual_current"))
    found, own = {}, {"left": {"motor_position_source": "input_double_register_24..29"}, "right": {}}
    for side, parameters in own.items():
        found[side] = [probe.collect(JointState, f"/{side}/{topic}") for topic in ("link_states", "motor_states")]
        start("driver", "-r", f"__ns:=/{side}", robot_ip=HOST, port=machine.port, stall_s=PAUSE_S, **parameters)
    probe.until(lambda: min(len(links) for links, _ in found.values()) > 3 * RATE, "3 s from both")
    probe.diagnostics.clear()
    for side, (links, _) in found.items():
        probe.until(lambda node=f"{side}/driver": probe.told(node, "publishing"), "a report")
        report = {v.key: v.value for v in probe.told(f"{side}/driver", "publishing").values}
        numbers_of(reader, links, int(report.get(WAITS, 0)))
        assert nanoseconds(links[0]) < nanoseconds(links[-1])
    assert {tuple(m.position) for m in found["left"][1]} == {(24.0, 25.0, 26.0, 27.0, 28.0, 29.0)}
    assert {len(m.position) for m in found["right"][1]} == {0}
    reader.close()
    writer.close()


BAD = [
    ({"robot_ip": " "}, "parameter robot_ip is missing"),
    ({"robot_ip": HOST, "joints": ["a", "b", "c", "d", "e", "a"]}, "give 6 different names"),
    ({"joints": list("abcdef"), "gear_ratio": [101.0, 50.0]}, "parameter gear_ratio has 2 values"),
    (
        {"gear_ratio": [101.0], "motor_position_source": "encoder0_raw"},
        "parameter motor_position_source = 'encoder0_raw'",
    ),
    ({"motor_position_source": "", "rate": 300.0}, "300"),
    ({"rate": 500.0, "use_sim_time": True}, "parameter use_sim_time is true"),
    ({"use_sim_time": False, "extra_fields": ["actual_current_as_torque"]}, "actual_current_as_torque"),
]


def test_what_cannot_be_is_told_in_one_line_and_can_be_mended(start, probe, robot):
    machine, old, lacking = (
        robot("--moving", "none", *more)
        for more in (["--version", "5.13.0"], ["--version", "3.15.8"], ["--without", "actual_current"])
    )
    process = start("driver", autostart=False, port=machine.port)
    links = probe.collect(JointState, "link_states")

    def refused(changes, text):
        for name, value in changes.items():
            assert probe.set_parameter("driver", name, value).successful, name
        before = process.text.count("not configured: ")
        assert not probe.change("driver", "configure")
        assert text in process.text
        assert process.text.count("not configured: ") == before + 1

    for changes, text in BAD:
        refused(changes, text)
    refused({"extra_fields": [""], "port": old.port}, "125")
    refused({"port": lacking.port}, "actual_current")
    probe.until(lambda: probe.told("driver", "actual_current"), "a report")
    assert probe.told("driver", "actual_current").level == b"\x02"

    assert probe.set_parameter("driver", "port", old.port).successful
    assert probe.set_parameter("driver", "rate", 125.0).successful
    assert probe.change("driver", "configure")
    refusal = probe.set_parameter("driver", "rate", 25.0)
    assert not refusal.successful and "rate is in use" in refusal.reason
    assert probe.change("driver", "activate")
    probe.until(lambda: len(links) > 125, "samples of an old robot")
    assert_steady(links[:125], 4 * PERIOD_NS, clock_shifts(report_from_now_on(probe)))
    assert links[0].name == list("abcdef")
    assert "Traceback" not in process.text


def test_nothing_is_published_but_while_active(start, probe, robot):
    machine = robot("--moving", "none")
    start("driver", autostart=False, robot_ip=HOST, port=machine.port)
    links = probe.collect(JointState, "link_states")
    assert probe.change("driver", "configure")
    probe.spin(0.5)
    assert not links
    for _ in range(2):
        assert probe.change("driver", "activate")
        count = len(links)
        probe.until(lambda count=count: len(links) > count + RATE, "a second of samples")
        assert probe.change("driver", "deactivate")
        answered = probe.get_clock().now().nanoseconds
        probe.spin(1.0)  # what is under way, however late, was stamped before
        assert nanoseconds(links[-1]) < answered + AHEAD_NS
    stamps = [nanoseconds(m) for m in links]
    assert stamps == sorted(set(stamps))
    assert probe.change("driver", "cleanup") and probe.state("driver") == "unconfigured"
    assert probe.change("driver", "configure") and probe.change("driver", "activate")
    assert probe.change("driver", "shutdown") and probe.state("driver") == "finalized"
    probe.until(lambda: probe.told("driver", "shut down"), "a report")


@pytest.mark.long
def test_a_driver_waits_for_its_robot_and_ends_cleanly_while_it_reconnects(start, probe, robot):
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
    process = start("driver", robot_ip=HOST, port=port, timeout=0.3, backoff_max_s=0.5)
    links = probe.collect(JointState, "link_states")
    probe.until(lambda: probe.told("driver", "not configured"), "a report")
    assert probe.told("driver", "not configured").level == b"\x02"
    assert f"{HOST}:{port}" in process.text and "trying again" in process.text
    machine = robot("--slow-start", "1.0", port=port)  # which at first takes connections but does not answer
    probe.until(lambda: len(links) > RATE, "samples")
    assert probe.state("driver") == "active"
    machine.stop()
    changed = robot("--without", "actual_current", port=port)  # an update took a field away
    probe.until(lambda: probe.told("driver", "no field actual_current"), "a report of the refusal")
    assert probe.told("driver", "no field actual_current").level == b"\x02"
    changed.stop()
    machine = robot(port=port)
    count = len(links)
    probe.until(lambda: len(links) > count + RATE, "samples again")
    machine.stop()
    probe.diagnostics.clear()
    probe.until(lambda: probe.told("driver", "not connected"), "a report of the end")
    assert probe.told("driver", "not connected").level == b"\x02"
    process.signal(signal.SIGINT)
    assert process.wait() == 0
    assert "Traceback" not in process.text


def test_a_refusal_is_not_tried_again_until_it_is_mended(start, probe, robot):
    machine = robot("--without", "actual_current")
    process = start("driver", robot_ip=HOST, port=machine.port)
    links = probe.collect(JointState, "link_states")
    probe.until(lambda: probe.told("driver", "no field actual_current"), "a report")
    probe.spin(1.0)
    assert process.text.count("not configured: ") == 1
    assert probe.set_parameter("driver", "current_source", "").successful
    assert probe.change("driver", "configure") and probe.change("driver", "activate")
    probe.until(lambda: links, "samples")
    assert len(links[0].position) == 6 and not len(links[0].effort)


@pytest.mark.parametrize("client", ["socket", "ur_rtde"])
def test_either_client_publishes_true_samples_and_sends_nothing_but_requests_to_read(
    start, probe, robot, domain, client
):
    machine = robot()
    host = f"127.0.1.{domain}"  # the port of ur_rtde is fixed: an address that no other test run uses
    wire = Wire(host, PORT, machine.port)
    links = probe.collect(JointState, "link_states")
    reader = Reader(machine.port, ("actual_q", "actual_current"))
    start("driver", robot_ip=host, client=client)
    probe.until(lambda: len(links) > 2 * RATE, "samples")
    published = measured(links)
    # The thread that reads may be later than the driver.
    probe.until(lambda: published[-1] in [sample[1:] for sample in reader.samples], "the same samples")
    reader.close()
    wire.close()
    assert set(published) <= {sample[1:] for sample in reader.samples}
    assert {b"O", b"S"} <= set(wire.kinds) <= {b"V", b"v", b"O", b"S", b"P"}


def test_no_module_of_the_driver_knows_a_way_to_move_a_robot():
    forbidden = re.compile(r"rtde_control|rtde_io|script_client|dashboard|\b3000[123]\b|\b29999\b|\bINPUTS\b|b\"I\"")
    own = [Path(joint_id_ros.__file__).parent / name for name in DRIVER_MODULES]
    shared = [p for p in Path(joint_id_core.rtde.__file__).parent.glob("*.py") if p.stem != "packets"]
    assert len(shared) > 5
    for path in (*own, *shared):
        assert not forbidden.search(path.read_text()), path
