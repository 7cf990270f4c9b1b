"""The emulator as a process: its clock, and the commands on standard input and from other processes."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from selectors import EVENT_READ, SelectSelector
from types import FrameType

from joint_id_core.arm.description import Description
from joint_id_core.design.files import read_trajectory
from joint_id_core.design.limits import JointLimits
from joint_id_core.emulator.command_socket import REFUSED, CommandSocket
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.faults import parse
from joint_id_core.emulator.reference import TICK_S
from joint_id_core.emulator.robots import Joint
from joint_id_core.emulator.server import Server
from joint_id_core.errors import JointIdError

_BEHIND_S = 1.0  # a longer delay is not caught up
_LONGEST_WAIT_S = 0.1  # short, because a signal does not end a wait
_BURST = 50  # most late ticks at once, so that clients are served in between


class Emulator:
    """A robot in real time: tick k is due k times 2 ms after the start, even if earlier ticks were late.

    Late ticks are caught up in a burst, each with its own timestamp. If the machine is more than 1 s behind, the
    schedule is shifted: the robot's clock then continues without a jump, but behind the true time.

    Args:
        joints: joints of the robot.
        moving: indices of the joints that move.
        amplitude: peak of their motion in rad.
        version: version of the controller.
        without: fields that it does not have.
        seed: seed of all random numbers.
        host: address to listen at.
        port: TCP port; 0 takes any free port.
        slow_start: time in s after each start in which connections are accepted, but requests are not answered.
        description: of the links; without, joints have no gravity and do not act on each other.
        limits: of the joints, for trajectories; without, their drives alone limit these.
        socket: file for commands of other processes; None: there is none.

    Raises:
        JointIdError: bad values, or cannot listen at this address and port or with this file.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        moving: Collection[int],
        amplitude: float,
        version: tuple[int, ...],
        without: Collection[str],
        seed: int,
        host: str,
        port: int,
        slow_start: float,
        description: Description | None = None,
        limits: JointLimits | None = None,
        socket: Path | None = None,
    ) -> None:
        self._new_controller: Callable[[], Controller] = lambda: Controller(
            joints, moving, amplitude, version, without, seed, description, limits
        )
        self._slow_start = slow_start
        self._selector = SelectSelector()  # it waits with a resolution below 1 ms, and it accepts any input file
        self._controller = self._new_controller()
        self._server = Server(host, port, self._controller, self._selector, seed)
        self._socket = None if socket is None else CommandSocket(socket, self._selector, self._carry_out)
        self._random = random.Random(seed)
        self._commands = b""
        self._start = self._silent_until = 0.0
        self._off_until: float | None = None  # during a power cycle
        self._told = False
        self._ended = False

    def run(self) -> None:
        """Serve until the command `quit`, SIGINT or SIGTERM.

        Raises:
            JointIdError: the simulation cannot go on, or another program took the port during a power cycle.
        """
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        if sys.stdin is not None and not sys.stdin.closed:
            self._selector.register(sys.stdin.fileno(), EVENT_READ, self._read_commands)
        self._power_up(time.monotonic())
        host, port = self._server.address
        _say(f"ready on {host}:{port}")
        try:
            while not self._ended:
                wait = self._off_until - time.monotonic() if self._off_until is not None else self._run_due_ticks()
                for key, _ in self._selector.select(min(max(0.0, wait), _LONGEST_WAIT_S)):
                    key.data(time.monotonic())
                if self._off_until is not None and time.monotonic() >= self._off_until:
                    self._controller = self._server.controller = self._new_controller()
                    self._power_up(time.monotonic())
        finally:
            self._server.close()
            if self._socket is not None:
                self._socket.close()
            self._selector.close()

    def _end(self, _signal: int, _frame: FrameType | None) -> None:
        self._ended = True

    def _power_up(self, now: float) -> None:
        self._off_until = None
        self._start, self._silent_until = now, now + self._slow_start
        self._server.listen()

    def _run_due_ticks(self) -> float:
        """Run the ticks that are due; return the time in s until the next one."""
        now = time.monotonic()
        due = self._start + self._controller.ticks * TICK_S
        if now - due > _BEHIND_S:
            if not self._told:
                self._told = True
                _complain(
                    f"{now - due:.1f} s behind: the machine is too slow or was stopped; the clock goes on from here"
                )
            self._start += now - due
            due = now
        for _ in range(_BURST):
            if due > now:
                break
            self._tick(now)
            due = self._start + self._controller.ticks * TICK_S
        return due - time.monotonic()

    def _tick(self, now: float) -> None:
        controller, server = self._controller, self._server
        controller.tick()
        if now >= self._silent_until:
            if server.streaming:
                controller.report()
                server.publish(controller.ticks)
            server.flush(now)
        controller.advance()

    def _read_commands(self, now: float) -> None:
        data = os.read(sys.stdin.fileno(), 65536)
        if not data:
            self._selector.unregister(sys.stdin.fileno())
            data = b"\n"  # the last line may have no line end
        *lines, self._commands = (self._commands + data).split(b"\n")
        for line in lines:
            if line.strip() and not self._ended:
                self._carry_out(line.decode(errors="replace"), now)

    def _carry_out(self, line: str, now: float) -> str:
        """Run a command; report and return the result in one line that begins with the command, or why it is none."""
        try:
            name, value = parse(line)
        except JointIdError as error:
            return self._refuse(str(error))
        if self._off_until is not None and name != "quit":
            return self._refuse(f"command {name}: the controller is off, for another {self._off_until - now:.1f} s")
        try:
            done = getattr(self, f"_{name.replace('-', '_')}")(value, now)
        except JointIdError as error:
            return self._refuse(f"command {name}: {error}")
        text = f"{name}: {done} (controller time {self._controller.ticks * TICK_S:.3f} s)"
        _say(text)
        return text

    @staticmethod
    def _refuse(why: str) -> str:
        _complain(why)
        return REFUSED + why

    def _drop(self, value: float, now: float) -> str:
        return self._spoil("drop", int(value), "not sent")

    def _zero(self, value: float, now: float) -> str:
        return self._spoil("zero", int(value), "all zero")

    def _nan(self, value: float, now: float) -> str:
        return self._spoil("nan", int(value), "with NaN in actual_q")

    def _spoil(self, how: str, count: int, what: str) -> str:
        clients = [c for c in self._server.connections if c.streaming]
        for output in (o for c in clients for o in c.outputs):
            setattr(output, how, getattr(output, how) + count)
        return f"next {count} samples {what}, clients {len(clients)}"

    def _stall(self, value: float, now: float) -> str:
        self._silent_until = max(self._silent_until, now + value)
        return f"nothing is sent for {value:g} s"

    def _kill(self, value: float, now: float) -> str:
        return f"{self._server.cut()} connections cut"

    def _power_cycle(self, value: float, now: float) -> str:
        count = self._server.cut()
        self._server.stop_listening()
        self._off_until = now + value
        return f"{count} connections cut, back in {value:g} s"

    def _power_off(self, value: float, now: float) -> str:
        return "brakes on" if self._controller.power(False) else "was off already"

    def _power_on(self, value: float, now: float) -> str:
        return "brakes off" if self._controller.power(True) else "was on already"

    def _protective_stop(self, value: float, now: float) -> str:
        return "the joints stop" if self._controller.protective_stop(True) else "was stopped already"

    def _unlock(self, value: float, now: float) -> str:
        return "the joints go on" if self._controller.protective_stop(False) else "was not stopped"

    def _pick_up(self, value: float, now: float) -> str:
        self._controller.arm.carry(value)
        return f"the last link carries {value:g} kg"

    def _put_down(self, value: float, now: float) -> str:
        self._controller.arm.carry(0.0)
        return "the last link carries nothing"

    def _follow(self, value: str, now: float) -> str:
        trajectory = read_trajectory(Path(value))
        begin_s = self._controller.follow(trajectory)
        return f"to the start within {begin_s:.1f} s, then {trajectory.duration:g} s of {', '.join(trajectory.names)}"

    def _stop(self, value: float, now: float) -> str:
        self._controller.arm.reference.stop()
        return "the joints come to rest"

    def _clock_jump(self, value: float, now: float) -> str:
        self._controller.clock_offset += value
        return f"{value:+g} s"

    def _garbage(self, value: float, now: float) -> str:
        data = self._random.randbytes(int(value))
        for connection in self._server.connections:
            connection.insert(data)
        return f"{len(data)} random bytes"

    def _fragment(self, value: float, now: float) -> str:
        self._server.fragment = bool(value)
        return "on" if value else "off"

    def _quit(self, value: float, now: float) -> str:
        self._ended = True
        return "the end"


def _say(text: str) -> None:
    """Print one line on standard output; a closed pipe is no error."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # Without this, Python would report the error again when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(text: str) -> None:
    print(f"robot-emulator: {text}", file=sys.stderr, flush=True)
