"""Many robots in one process: their nodes share one context, one executor and the main loop.

A process costs 130 MB and a participant of the middleware, and its executor takes some percent of a core only to look
whether there is something to do. Nodes that share a process share these.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.parameter import Parameter

from joint_id_core.errors import JointIdError
from joint_id_ros.launch_files import NodeStart
from joint_id_ros.parameters import PARAMETER_ERRORS
from joint_id_ros.robots_file import Robot
from joint_id_ros.running import Runnable, node_class

PACE_S = 0.05  # shortest time between two readings of a stream: many samples at once cost little more than one
TURN_S = 0.1  # time between two turns of the executor, each of which serves all that is ready
TICK_S = 0.01  # time between two looks at what is due


@dataclass
class Member:
    """A node of a robot."""

    robot: str
    node: Any
    due_s: float = 0.0  # when its streams are read next


class Members:
    """The nodes of robots; what goes wrong with one robot ends its nodes alone.

    The interface is that of `Streams`, so that the main loop of a process (`running.py`) drives them.

    Attributes:
        read_s: time until the next reading is due.
        left_out: why robots are not identified, by name.
    """

    def __init__(self, robots: Iterable[Robot], tell: Callable[[str, str], None]) -> None:
        """Make the nodes; `tell` takes kind and text of a problem."""
        self.read_s = TICK_S
        self.left_out: dict[str, str] = {}
        self._tell = tell
        self._members: list[Member] = []
        self._executor = SingleThreadedExecutor()
        self._turn_s = 0.0
        for robot in robots:
            self._begin(robot)

    @property
    def robots(self) -> list[str]:
        """Names of the robots that have nodes."""
        return list(dict.fromkeys(member.robot for member in self._members))

    def read(self) -> None:
        """Read the streams that are due, and serve timers, services and messages of all nodes."""
        now = time.monotonic()
        for member in self._members.copy():
            if (streams := member.node.streams) is not None and now >= member.due_s:
                member.due_s = now + max(PACE_S, streams.read_s)
                self._guarded(member.robot, streams.read)
        if now >= self._turn_s:
            self._serve()
            self._turn_s = time.monotonic() + TURN_S

    def close(self) -> None:
        """End all nodes."""
        for robot in self.robots:
            self._end(robot)
        self._executor.shutdown()

    def _begin(self, robot: Robot) -> None:
        try:
            if robot.problem:
                raise JointIdError(robot.problem)
            for start in robot.starts:
                node = _made(robot.name, start)
                self._members.append(Member(robot.name, node))
                self._executor.add_node(node)
        except (JointIdError, *PARAMETER_ERRORS) as error:
            self._leave_out(robot.name, str(error))
        except Exception as error:  # the others go on
            self._leave_out(robot.name, _where(error))

    def _serve(self) -> None:
        """Run every callback that is ready; the executor looks only once which these are."""
        try:
            while True:
                task, _, node = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
                task()
                if (error := task.exception()) is not None:
                    self._failed(node, error)
        except TimeoutException:
            pass  # nothing is left

    def _failed(self, node: Any, error: BaseException) -> None:
        for robot in [member.robot for member in self._members if member.node is node]:
            self._leave_out(robot, _where(error))

    def _guarded(self, robot: str, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:  # a bug must not end the other robots
            self._leave_out(robot, _where(error))

    def _leave_out(self, robot: str, why: str) -> None:
        self.left_out[robot] = why
        self._tell(f"{robot} left out", f"{robot} is left out: {why}")
        self._end(robot)

    def _end(self, robot: str) -> None:
        for member in [member for member in self._members if member.robot == robot]:
            self._members.remove(member)
            self._executor.remove_node(member.node)
            member.node.close()
            member.node.destroy_node()


def load(robots: Iterable[Robot]) -> None:
    """Import what the nodes of robots need."""
    for name in {start.name for robot in robots for start in robot.starts}:
        node_class(name)


def _made(robot: str, start: NodeStart) -> Runnable:
    """Make a node of a robot, with its own arguments and none of those of this process."""
    arguments = ["--ros-args", "-r", f"__ns:=/{robot}"]
    for path in start.files:
        arguments += ["--params-file", path]
    for source, target in start.remappings:
        arguments += ["-r", f"{source}:={target}"]
    given = [Parameter(name, value=value) for name, value in start.given.items()]
    made: Runnable = node_class(start.name)(cli_args=arguments, use_global_arguments=False, parameter_overrides=given)
    return made


def _where(error: BaseException) -> str:
    """Return an exception and the place that raised it, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"internal error: {type(error).__name__}: {' '.join(str(error).split())} ({frame.filename}:{frame.lineno})"
