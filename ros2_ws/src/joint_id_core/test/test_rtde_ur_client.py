"""The client over ur_rtde, in a process of its own: while it connects, nothing else runs in its process.

Each test has a loopback address of its own, as the port is fixed.
"""

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from joint_id_core.rtde.client import Request
from joint_id_core.rtde.errors import RefusedError, UnreachableError
from joint_id_core.rtde.ur_rtde_client import GETTERS, UrRtdeClient

pytest.importorskip("rtde_receive")

PATIENCE_S = 60.0  # a limit for tests that hang
FIELDS = ("timestamp", "actual_q", "joint_mode", "robot_mode", "actual_qd")

READER = """
import json, sys, threading, time
from joint_id_core.rtde.client import Request
from joint_id_core.rtde.ur_rtde_client import UrRtdeClient

def say(what):
    print(json.dumps(what), flush=True)

client = UrRtdeClient(Request(sys.argv[1], tuple(sys.argv[2].split(",")), timeout=10.0))
client.open()
client.start()
say(client.version)
for line in sys.stdin:
    command, _, number = line.strip().partition(" ")
    try:
        if command == "read":
            samples, end = [], time.monotonic() + 30.0
            while len(samples) < int(number) and time.monotonic() < end:
                samples += client.read(1.0)
            say([(s.received_ns, s.values) for s in samples])
        elif command == "wait":
            say(client.read(float(number)))
        elif command == "close":
            raised = []
            def read():
                try:
                    client.read(100.0)
                except Exception as error:
                    raised.append(f"{type(error).__name__}: {error}")
            thread = threading.Thread(target=read)
            thread.start()
            time.sleep(0.05)
            client.close()
            client.close()
            thread.join(30.0)
            say(raised)
    except Exception as error:
        say(f"{type(error).__name__}: {error}")
"""


class Child:
    """A process that answers lines with lines; it is ended when it has not after a while."""

    def __init__(self, *command):
        self.process = subprocess.Popen(
            [sys.executable, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

        self.watchdog = threading.Timer(PATIENCE_S, self.process.kill)
        self.watchdog.start()

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def end(self):
        """Exit code and standard error after the end of its input."""
        _, errors = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, errors


@pytest.fixture
def child():
    """Start a process."""
    children = []

    def start(*command):
        children.append(Child(*command))
        return children[-1]

    yield start
    for child in children:
        child.watchdog.cancel()
        if child.process.poll() is None:
            child.process.kill()
            child.process.communicate()


@pytest.fixture
def robot(child):
    """Start a robot."""

    def start(host, period_s=0.002):
        robot = child(str(Path(__file__).with_name("counting_robot.py")), host, str(period_s))
        assert robot.process.stdout.readline() == "ready\n"
        return robot

    return start


@pytest.fixture
def reader(robot, child):
    """Start a robot and a process that reads it."""

    def start(host, period_s=0.002):
        server, reader = robot(host, period_s), child("-c", READER, host, ",".join(FIELDS))
        assert json.loads(reader.process.stdout.readline()) == [5, 13, 0, 0]
        return server, reader

    return start


def test_every_sample_is_whole(reader):
    """From a robot so fast that new samples often come while one is being read."""
    _, child = reader("127.0.0.23", 0.0002)
    samples = child.ask("read 500")
    numbers = []
    for _, values in samples:
        number = values["robot_mode"]
        numbers.append(number)
        assert values["timestamp"] == pytest.approx(0.002 * number, abs=1e-9)
        assert values["actual_q"] == values["actual_qd"] == values["joint_mode"] == [number] * 6
    assert len(numbers) >= 500
    assert numbers == sorted(set(numbers))
    received = [at for at, _ in samples]
    assert received == sorted(received)


def test_a_connection_that_is_cut(reader):
    robot, child = reader("127.0.0.24")
    assert child.ask("read 1")
    robot.ask("cut")
    lost = "UnreachableError: robot 127.0.0.24:30004: ur_rtde has lost the connection"
    for _ in range(100):  # samples from before
        answer = child.ask("wait 5.0")
        if isinstance(answer, str):
            break
    assert answer == lost
    assert child.end()[0] == 0


@pytest.mark.long
def test_silence_and_closing(reader):
    """A read of a silent robot ends when it is closed, and so does the process, with nothing left."""
    robot, child = reader("127.0.0.25")
    assert child.ask("read 1")
    robot.ask("mute")
    while child.ask("wait 0.3"):
        pass
    closed = "UnreachableError: robot 127.0.0.25:30004: the connection is closed on this side"
    assert child.ask("close") == [closed]
    assert child.ask("wait 0.0") == closed
    code, errors = child.end()
    assert code == 0, errors


def test_a_robot_that_starts_but_sends_nothing_never_gets_as_far_as_the_library(robot):
    """There it would hang, and with it this whole process."""
    robot("127.0.0.27").ask("mute")
    client = UrRtdeClient(Request("127.0.0.27", FIELDS, timeout=2.0))
    with pytest.raises(UnreachableError, match=r"robot 127\.0\.0\.27:30004 sends nothing within 2 s"):
        client.open()


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (Request("127.0.0.1", ("timestamp",), port=30005), "ur_rtde only knows port 30004: use the client socket"),
        (
            Request("127.0.0.1", ("timestamp", "actual_current_as_torque", "output_double_register_24")),
            "ur_rtde does not give actual_current_as_torque, output_double_register_24: use the client socket",
        ),
    ],
)
def test_what_it_cannot_do_is_refused_without_a_connection(request_, message):
    with pytest.raises(RefusedError, match=message):
        UrRtdeClient(request_).open()


def test_without_the_library_it_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rtde_receive", None)
    with pytest.raises(RefusedError, match="pip install ur-rtde, or use the client socket"):
        UrRtdeClient(Request("127.0.0.26", ("timestamp",))).open()


def test_a_robot_that_is_not_there_is_told_as_by_the_client_socket():
    with pytest.raises(UnreachableError, match=r"robot 127\.0\.0\.26:30004: refuses the connection"):
        UrRtdeClient(Request("127.0.0.26", ("timestamp",))).open()


def test_every_getter_exists():
    from rtde_receive import RTDEReceiveInterface

    assert [g for g in GETTERS.values() if not hasattr(RTDEReceiveInterface, g)] == []
