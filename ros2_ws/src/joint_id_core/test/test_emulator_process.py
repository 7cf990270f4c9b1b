"""`joint-id robot-emulator` as a process: how it starts, goes off and on again, and ends, and its options."""

import signal
import struct
import subprocess
import time

import numpy as np
import pytest
import yaml

from joint_id_core.cli import app
from joint_id_core.emulator.faults import COMMANDS
from joint_id_core.emulator.process import COMMAND, EmulatorProcess
from joint_id_core.emulator.robots import build_joints
from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive

from .plain_client import MODE, PATIENCE_S, TIME, Client, steps_of


@pytest.fixture
def start():
    running = []

    def call(*arguments):
        running.append(EmulatorProcess(*arguments))
        return running[-1]

    yield call
    for emulator in running:
        emulator.stop()


def test_a_power_cycle_refuses_clients_and_begins_anew(start):
    emulator = start("--moving", "none")
    client = Client(emulator.port).start()
    emulator.tell("clock-jump 1000")
    emulator.tell("power-off")
    client.samples_until(lambda row: row[MODE] == 3)
    begun = time.monotonic()
    assert emulator.tell("power-cycle 0.5").startswith("power-cycle: 1 connections cut, back in 0.5 s")
    with pytest.raises(EOFError):
        client.samples(100000)
    with pytest.raises(ConnectionRefusedError):
        Client(emulator.port)
    emulator.give("drop")
    emulator.wait_for_error("command drop: the controller is off, for another")
    while True:
        try:
            again = Client(emulator.port).start()
            break
        except ConnectionRefusedError:
            assert time.monotonic() < begun + PATIENCE_S
            time.sleep(0.01)
    row = again.samples(1)[0]
    assert 0.0 <= row[TIME] <= time.monotonic() - begun - 0.5
    assert row[MODE] == 7


def test_a_slow_start_takes_connections_but_answers_late(start):
    emulator = start("--slow-start", "0.6", "--moving", "none")
    client = Client(emulator.port)
    client.send("V", b"\x00\x02")
    client.socket.settimeout(0.2)
    with pytest.raises(TimeoutError):
        client.packet()
    client.socket.settimeout(PATIENCE_S)
    assert client.packet() == ("V", b"\x01")
    client.start()
    assert client.samples(1)[0, TIME] >= 0.6


def test_a_process_that_was_stopped_catches_up_or_goes_on_without_a_jump(start):
    emulator = start("--moving", "none")
    client = Client(emulator.port).start()
    rows = [client.samples(50)]
    lag = time.monotonic() - rows[-1][-1, TIME]
    for pause, lost in ((0.4, 0.0), (1.4, 1.4)):
        emulator.process.send_signal(signal.SIGSTOP)
        time.sleep(pause)
        emulator.process.send_signal(signal.SIGCONT)
        # Long enough to catch up with 1.4 s, if it wanted to.
        rows.append(client.samples(900))
        late = time.monotonic() - rows[-1][-1, TIME] - lag
        assert late > lost - 0.5
        if not lost:
            assert emulator.errors == ""
    np.testing.assert_array_equal(steps_of(np.concatenate(rows)), 1.0)
    emulator.wait_for_error("s behind: the machine is too slow or was stopped; the clock goes on from here")
    assert len(emulator.complaints) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_with_exit_code_0(start, number):
    emulator = start("--moving", "none")
    client = Client(emulator.port).start()
    client.samples(3)
    if number == signal.SIGTERM:
        emulator.tell("power-cycle 1000")
    emulator.process.send_signal(number)
    assert emulator.process.wait(PATIENCE_S) == 0
    assert emulator.errors == ""
    with pytest.raises(EOFError):
        client.samples(100000)


def test_quit_ends_it_and_the_end_of_the_commands_does_not(start):
    emulator = start("--moving", "none")
    emulator.process.stdin.write("drop")  # a last line without its end
    emulator.process.stdin.close()
    emulator.wait_for("drop: ")
    Client(emulator.port).start().samples(100)
    assert emulator.process.poll() is None
    other = start("--moving", "none")
    assert other.tell("quit").startswith("quit: ")
    assert other.process.wait(PATIENCE_S) == 0


def test_the_truth_is_written_before_it_is_ready(start, tmp_path):
    file = tmp_path / "truth.yaml"
    emulator = start("--robot", "ur5e", "--truth", str(file), "--moving", "none", "--host", "127.0.0.2")
    assert emulator.ready == f"ready on 127.0.0.2:{emulator.port}"
    truth = yaml.safe_load(file.read_text())
    assert truth == {j.name: j.values for j in build_joints("ur5e")}
    model = HarmonicDrive(actuation="current")
    assert all(set(values) == set(model.parameter_names) for values in truth.values())
    assert next(iter(truth)) == "shoulder_pan_joint"


def test_version_and_missing_fields_are_as_asked(start):
    emulator = start("--version", "3.15.1", "--without", "joint_mode", "--without", "safety_mode", "--moving", "none")
    client = Client(emulator.port)
    client.ask("V", b"\x00\x02")
    assert client.ask("v") == struct.pack(">4I", 3, 15, 1, 0)
    wanted = "joint_mode,safety_mode,actual_current_as_torque,robot_mode"
    assert client.ask("O", struct.pack(">d", 125.0) + wanted.encode()) == b"\x00NOT_FOUND,NOT_FOUND,NOT_FOUND,INT32"
    client.ask("O", struct.pack(">d", 500.0) + b"timestamp")
    client.ask("S")
    times = [struct.unpack(">Bd", client.packet()[1])[1] for _ in range(30)]
    np.testing.assert_allclose(np.diff(times), 0.008)  # such controllers send 125 Hz at most


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--robot", "ur7"], "unknown robot 'ur7': choose one of ur3e, ur5e, ur10e"),
        (["--version", "five"], "--version five: write it as 5.13.0"),
        (["--without", "actual_p"], "--without actual_p: no such field"),
        (["--moving", "6"], "--moving 6: write all, none, or numbers from 0 to 5"),
        (["--moving", "0,,1"], "--moving 0,,1"),
        (["--amplitude", "nan"], "--amplitude nan: give rad from 0 to 3"),
        (["--slow-start", "-1"], "--slow-start -1: give a time in s"),
        (["--seed", "-1"], "--seed -1: give a number from 0 on"),
        (["--truth", "/no/such/folder/truth.yaml"], "choose a file that can be written"),
        (["--host", "192.0.2.1"], "cannot listen at 192.0.2.1:0"),
        (["--port", "70000"], "cannot listen at 127.0.0.1:70000"),
        (["--port", "http"], "--port"),
    ],
)
def test_bad_options_are_one_line_and_exit_code_2(capsys, arguments, says):
    with pytest.raises(SystemExit) as end:
        app(["robot-emulator", "--port", "0", *arguments], prog_name="joint-id")
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1


def test_nobody_need_listen_to_what_it_prints():
    pipe = subprocess.PIPE
    with subprocess.Popen([*COMMAND, "--port", "0", "--moving", "none"], stdin=pipe, stdout=pipe, text=True) as alone:
        client = Client(int(alone.stdout.readline().rpartition(":")[2])).start()
        alone.stdout.close()
        print("drop", file=alone.stdin, flush=True)
        client.samples(100)
        assert alone.poll() is None
        alone.kill()


def test_a_port_that_is_taken_is_told(start):
    emulator = start("--moving", "none")
    with pytest.raises(JointIdError, match=f"exit code 2: .*cannot listen at 127.0.0.1:{emulator.port}"):
        EmulatorProcess("--port", str(emulator.port))


def test_help_explains_every_command(run):
    code, out, _ = run("robot-emulator", "--help")
    assert code == 0
    for command in COMMANDS.values():
        assert command.name in out
        assert command.meaning in out
    assert "output_double_register_24..29" in " ".join(out.split())
