"""`joint-id robot-emulator` as a process: what clients on real sockets see of it, and of every fault."""

import socket
import struct
import time

import numpy as np
import pytest

from joint_id_core.emulator.process import EmulatorProcess

from .plain_client import FIELDS, MODE, PATIENCE_S, SAFETY, SAMPLE, TIME, Client, steps_of


@pytest.fixture(scope="module")
def shared():
    """One emulator for the tests that leave it as it was; only two joints move."""
    with EmulatorProcess("--moving", "0,3") as emulator:
        yield emulator


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
