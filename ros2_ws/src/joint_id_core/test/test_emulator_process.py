"""`joint-id robot-emulator` as a process: what clients on real sockets see of it, and of every fault."""

import select
import signal
import socket
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml

from joint_id_core.cli import app
from joint_id_core.emulator.faults import COMMANDS
from joint_id_core.emulator.robots import build_joints
from joint_id_core.models import HarmonicDrive

PATIENCE_S = 30.0  # a limit for tests that hang, not a measure of speed
FIELDS = "timestamp,actual_q,actual_qd,actual_current,robot_mode,safety_mode"
SAMPLE = struct.Struct(">B19d2i")
TIME, MODE, SAFETY = 1, 20, 21


class Emulator:
    """The process, its commands and its lines."""

    def __init__(self, log, *arguments):
        self._log = log
        with log.open("w") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-c", "from joint_id_core.cli import main; main()", "robot-emulator", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                bufsize=0,
            )
        self.ready = self.line()
        if self.ready:
            self.port = int(self.ready.rsplit(":", 1)[1])

    def line(self):
        """Next line of standard output."""
        assert select.select([self.process.stdout], [], [], PATIENCE_S)[0], f"it says nothing: {self.errors}"
        return self.process.stdout.readline().decode().rstrip("\n")

    def tell(self, command):
        """Give a command; return what is said of it."""
        self.give(command)
        return self.line()

    def give(self, command):
        """Give a command that is not answered."""
        self.process.stdin.write(f"{command}\n".encode())

    @property
    def errors(self):
        return self._log.read_text()

    def wait_for_error(self, text):
        end = time.monotonic() + PATIENCE_S
        while text not in self.errors:
            assert time.monotonic() < end, self.errors
            time.sleep(0.01)

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


class Client:
    """A reader of RTDE that knows only its framing."""

    def __init__(self, port, patience=PATIENCE_S):
        self.socket = socket.create_connection(("127.0.0.1", port), patience)

    def send(self, kind, payload=b""):
        self.socket.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def exactly(self, count):
        got = b""
        while len(got) < count:
            part = self.socket.recv(count - len(got))
            if not part:
                raise EOFError
            got += part
        return got

    def packet(self):
        size, kind = struct.unpack(">HB", self.exactly(3))
        return chr(kind), self.exactly(size - 3)

    def ask(self, kind, payload=b""):
        self.send(kind, payload)
        answered, answer = self.packet()
        assert answered == kind
        return answer

    def start(self, hertz=500.0, fields=FIELDS):
        assert self.ask("V", b"\x00\x02") == b"\x01"
        self.types = self.ask("O", struct.pack(">d", hertz) + fields.encode())
        assert self.ask("S") == b"\x01"
        return self

    def samples(self, count):
        """Rows of the next data packets, shape (count, 22): recipe and the fields."""
        rows = []
        while len(rows) < count:
            kind, payload = self.packet()
            assert kind == "U"
            rows.append(SAMPLE.unpack(payload))
        return np.array(rows)

    def samples_until(self, wanted, most=20000):
        """All rows up to the first for which `wanted` holds."""
        rows = []
        for _ in range(most):
            rows.append(self.samples(1)[0])
            if wanted(rows[-1]):
                return np.array(rows)
        raise AssertionError("it never came")


@pytest.fixture
def start(tmp_path):
    running = []

    def call(*arguments):
        running.append(Emulator(tmp_path / f"{len(running)}.log", "--port", "0", *arguments))
        return running[-1]

    yield call
    for emulator in running:
        emulator.end()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """One emulator for the tests that leave it as it was; only two joints move."""
    emulator = Emulator(tmp_path_factory.mktemp("emulator") / "log", "--port", "0", "--moving", "0,3")
    yield emulator
    emulator.end()


def steps_of(rows):
    """Steps of the controller's clock, in samples of 500 Hz."""
    return np.round(np.diff(rows[:, TIME]) * 500.0, 6)


def test_it_streams_every_sample_of_a_moving_robot(shared):
    client = Client(shared.port).start()
    assert client.types == b"\x01DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,INT32,INT32"
    rows = client.samples(1000)
    np.testing.assert_array_equal(steps_of(rows), 1.0)
    ticks = np.round(rows[:, TIME] / 0.002)
    np.testing.assert_array_equal(rows[:, TIME], ticks * 0.002)  # to the last bit
    assert np.ptp(rows[:, 2]) > 0.1 < np.ptp(rows[:, 5])
    assert np.ptp(rows[:, 3]) < 1e-3
    np.testing.assert_array_equal(rows[:, (MODE, SAFETY)], [[7, 1]] * 1000)


def test_the_clock_is_that_of_the_wall(shared):
    client = Client(shared.port).start(125.0)
    client.samples(1)
    begun, first = time.monotonic(), client.samples(1)[0, TIME]
    last = client.samples(125)[-1, TIME]
    assert last - first == pytest.approx(1.0)
    # Never faster than true time, by more than what waited in the network.
    assert time.monotonic() - begun > last - first - 0.5


def test_slower_clients_get_the_samples_of_their_rate(shared):
    fast, slow = Client(shared.port).start(), Client(shared.port).start(125.0)
    rows = slow.samples(40)
    np.testing.assert_array_equal(steps_of(rows), 4.0)
    both = {row[TIME]: row for row in fast.samples(200)}
    common = [row for row in rows if row[TIME] in both]
    assert len(common) > 20
    for row in common:
        np.testing.assert_array_equal(row, both[row[TIME]])


def test_pause_and_start_again(shared):
    client = Client(shared.port).start()
    client.samples(5)
    client.send("P")
    while client.packet()[0] == "U":
        pass
    client.socket.settimeout(0.1)
    with pytest.raises(TimeoutError):
        client.packet()
    client.socket.settimeout(PATIENCE_S)
    assert client.ask("S") == b"\x01"
    np.testing.assert_array_equal(steps_of(client.samples(20)), 1.0)


def test_a_malformed_client_does_not_disturb_the_others(shared):
    good, bad = Client(shared.port).start(), Client(shared.port)
    good.samples(5)
    bad.socket.sendall(b"GET / HTTP/1.1\r\n\r\n")
    kind, text = bad.packet()
    assert kind == "M"
    assert b"not RTDE" in text
    assert bad.socket.recv(1) == b""
    reset = Client(shared.port).start()
    reset.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    reset.socket.close()  # not an end but a reset
    np.testing.assert_array_equal(steps_of(good.samples(300)), 1.0)


def test_many_clients_at_once(shared):
    clients = [Client(shared.port).start() for _ in range(6)]
    rows = [np.concatenate(parts) for parts in zip(*([c.samples(20) for c in clients] for _ in range(5)), strict=True)]
    for row in rows:
        np.testing.assert_array_equal(steps_of(row), 1.0)


def test_a_client_that_never_reads_does_not_disturb_the_others(shared):
    good, lazy = Client(shared.port).start(), Client(shared.port)
    lazy.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lazy.start(fields=FIELDS)
    np.testing.assert_array_equal(steps_of(good.samples(1500)), 1.0)
    # It has lost samples, but what it gets is whole.
    now = good.samples(1)[0, TIME]
    rows = lazy.samples_until(lambda row: row[TIME] >= now)
    assert steps_of(rows).max() > 100


def test_the_velocity_registers_hold_what_actual_qd_holds(shared):
    names = ",".join(f"output_double_register_{k}" for k in range(24, 36))
    client = Client(shared.port).start(fields=f"actual_q,actual_qd,{names}")
    kind, payload = client.packet()
    assert kind == "U"
    values = np.array(struct.unpack(">B24d", payload)[1:]).reshape(4, 6)
    np.testing.assert_allclose(values[2] / 101.0, values[0], atol=0.02)  # but for the twist of the gear
    np.testing.assert_allclose(values[3] / 101.0, values[1], rtol=1e-12)


def test_drop(shared):
    client = Client(shared.port).start()
    before = client.samples(3)
    assert shared.tell("drop 5").startswith("drop: next 5 samples not sent")
    steps = steps_of(np.concatenate([before, client.samples(100)]))
    assert sorted(steps)[-2:] == [1.0, 6.0]


def test_zero_and_nan(shared):
    client = Client(shared.port).start()
    client.samples(3)
    assert shared.tell("zero 2").startswith("zero: ")
    rows = client.samples(200)
    zero = ~rows[:, 1:].any(axis=1)
    assert np.flatnonzero(zero).size == 2
    assert np.isfinite(rows).all()
    assert shared.tell("nan 3").startswith("nan: ")
    rows = client.samples(200)
    bad = np.isnan(rows[:, 2:8]).all(axis=1)
    assert bad.sum() == 3
    assert np.isfinite(np.delete(rows, np.s_[2:8], axis=1)).all()
    np.testing.assert_array_equal(steps_of(rows), 1.0)


def test_stall(shared):
    client = Client(shared.port).start()
    before = client.samples(3)
    assert shared.tell("stall 0.3").startswith("stall: nothing is sent for 0.3 s")
    late = Client(shared.port)
    late.send("V", b"\x00\x02")
    steps = np.sort(steps_of(np.concatenate([before, client.samples(100)])))
    assert steps[-2] == 1.0
    assert 140 <= steps[-1] < 1000
    assert late.packet() == ("V", b"\x01")


def test_fragments(shared):
    client = Client(shared.port).start()
    assert shared.tell("fragment on").startswith("fragment: on")
    rows = client.samples(300)
    np.testing.assert_array_equal(steps_of(rows), 1.0)
    other = Client(shared.port).start()
    np.testing.assert_array_equal(steps_of(other.samples(50)), 1.0)
    assert shared.tell("fragment off").startswith("fragment: off")
    np.testing.assert_array_equal(steps_of(client.samples(300)), 1.0)


def test_garbage(shared):
    client = Client(shared.port).start()
    client.samples(3)
    assert shared.tell("garbage 40").startswith("garbage: 40 random bytes")
    packet = SAMPLE.size + 3
    data = client.exactly(100 * packet + 40)
    head = struct.pack(">HBB", packet, ord("U"), 1)
    at = next(k for k in range(0, len(data), packet) if data[k : k + 4] != head)
    rest = data[at + 40 :]
    assert len(rest) >= packet
    assert all(rest[k : k + 4] == head for k in range(0, len(rest), packet))  # whole packets follow on it


def test_kill(shared):
    clients = [Client(shared.port).start() for _ in range(2)]
    assert shared.tell("kill").startswith("kill: ")
    for client in clients:
        with pytest.raises(EOFError):
            client.samples(100000)
    Client(shared.port).start().samples(3)


def test_clock_jump(shared):
    client = Client(shared.port).start()
    for jump in (3.5, -7.0, 3.5):
        before = client.samples(3)
        assert shared.tell(f"clock-jump {jump}").startswith(f"clock-jump: {jump:+g} s")
        steps = steps_of(np.concatenate([before, client.samples(150)]))
        assert np.count_nonzero(steps != 1.0) == 1
        assert steps[steps != 1.0][0] == pytest.approx(jump * 500 + 1)


def test_protective_stop_and_unlock(shared):
    client = Client(shared.port).start()
    client.samples(100)
    assert shared.tell("protective-stop").startswith("protective-stop: the joints stop")
    assert shared.tell("protective-stop").startswith("protective-stop: was stopped already")
    client.samples_until(lambda row: row[SAFETY] == 3)
    client.samples(200)
    still = client.samples(100)
    np.testing.assert_array_equal(still[:, (MODE, SAFETY)], [[7, 3]] * 100)
    assert np.ptp(still[:, 2:8], axis=0).max() < 1e-3
    assert abs(still[:, 8:14]).max() < 0.01
    assert shared.tell("unlock").startswith("unlock: the joints go on")
    assert shared.tell("unlock").startswith("unlock: was not stopped")
    client.samples_until(lambda row: row[SAFETY] == 1)
    rows = client.samples(500)
    assert np.ptp(rows[:, 2]) > 0.1
    np.testing.assert_array_equal(steps_of(rows), 1.0)


def test_power_off_and_on(shared):
    client = Client(shared.port).start()
    client.samples(100)
    assert shared.tell("power-off").startswith("power-off: brakes on")
    assert shared.tell("power-off").startswith("power-off: was off already")
    client.samples_until(lambda row: row[MODE] == 3)
    off = client.samples(100)
    np.testing.assert_array_equal(off[:, 8:20], 0.0)
    np.testing.assert_array_equal(off[:, 2:8], np.tile(off[0, 2:8], (100, 1)))
    np.testing.assert_array_equal(off[:, MODE], 3)
    assert shared.tell("power-on").startswith("power-on: brakes off")
    assert shared.tell("power-on").startswith("power-on: was on already")
    client.samples_until(lambda row: row[MODE] == 7)
    assert np.ptp(client.samples(500)[:, 2]) > 0.1


def test_wrong_commands_are_told_and_change_nothing(shared):
    client = Client(shared.port).start()
    for command in ("explode", "drop 0", "clock-jump", "", "   "):
        shared.give(command)
    shared.wait_for_error("command clock-jump needs an argument")
    assert "robot-emulator: unknown command 'explode': the commands are drop" in shared.errors
    assert "robot-emulator: command drop 0: write drop [N=1], e.g. drop 3" in shared.errors
    np.testing.assert_array_equal(steps_of(client.samples(100)), 1.0)


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
    assert emulator.errors.count("\n") == 1


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
    emulator.process.stdin.write(b"drop")  # a last line without its end
    emulator.process.stdin.close()
    assert emulator.line().startswith("drop: ")
    Client(emulator.port).start().samples(100)
    emulator.process.stdout.close()  # nobody listens any more
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


def test_a_port_that_is_taken_is_told(start, tmp_path):
    emulator = start("--moving", "none")
    second = Emulator(tmp_path / "second", "--port", str(emulator.port))
    assert second.process.wait(PATIENCE_S) == 2
    assert f"cannot listen at 127.0.0.1:{emulator.port}" in second.errors
    second.end()


def test_help_explains_every_command():
    done = subprocess.run(
        [sys.executable, "-c", "from joint_id_core.cli import main; main()", "robot-emulator", "--help"],
        capture_output=True, text=True, timeout=PATIENCE_S, check=True,
    )  # fmt: skip
    for command in COMMANDS.values():
        assert command.name in done.stdout
        assert command.meaning in done.stdout
    assert "output_double_register_24..29" in " ".join(done.stdout.split())
