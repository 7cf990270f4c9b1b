"""Node `fleet`: runs the nodes of many robots, each in its namespace, in one process or in some."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future

from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.fleet_processes import FleetProcesses
from joint_id_ros.members import Members, load
from joint_id_ros.options.fleet import FleetOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.robots_file import Robot, read_robots

CHECK_S = 0.5  # period of the checks that the processes run


class FleetNode(Node):
    """Runs its share of the robots, or starts the processes that do."""

    def __init__(self) -> None:
        super().__init__("fleet")
        self.finished = Future()
        declare(self, FleetOptions)
        self._options = read(self, FleetOptions)
        self._robots = read_robots(self._options.robots)
        load(self._robots)  # takes seconds, in which no diagnostics are due yet
        self._diagnostics = Diagnostics(self, self._health)
        self._processes: FleetProcesses | None = None
        self.streams: Members | None = None
        n = min(self._options.processes, len(self._robots))
        if n > 1 and not self._options.part:
            self._processes = FleetProcesses(
                [self._arguments(k, n) for k in range(1, n + 1)], self._diagnostics.problem
            )
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(CHECK_S, self._processes.check, clock=steady)
        else:
            self.streams = Members(self._share(), self._diagnostics.problem)
            self.get_logger().info(f"identifying {', '.join(self.streams.robots) or 'no robot'}")

    def _share(self) -> tuple[Robot, ...]:
        part = self._options.part
        return self._robots[part - 1 :: self._options.processes] if part else self._robots

    def _arguments(self, part: int, processes: int) -> list[str]:
        """Return the arguments of the process that has a part of the robots."""
        given = {"robots": self._options.robots, "processes": processes, "part": part}
        parameters = [text for name, value in given.items() for text in ("-p", f"{name}:={value}")]
        return ["--ros-args", "-r", f"__node:={self.get_name()}_{part}", *parameters]

    def _health(self) -> Health:
        if self._processes is not None:
            values: dict[str, object] = {"robots": len(self._robots), "processes started again": self._processes.ended}
            count, wanted = self._processes.running, min(self._options.processes, len(self._robots))
            level = DiagnosticStatus.OK if count == wanted else DiagnosticStatus.ERROR
            return Health(level, f"{count} of {wanted} processes run", values)
        assert self.streams is not None
        values = {"robots": ", ".join(self.streams.robots)}
        wrong = [f"{name} is left out: {why}" for name, why in self.streams.left_out.items()]
        level = DiagnosticStatus.ERROR if wrong else DiagnosticStatus.OK
        return Health(level, "; ".join(wrong) or f"{len(self.streams.robots)} robots", values)

    def close(self) -> None:
        """End all nodes, or all processes."""
        for part in (self.streams, self._processes):
            if part is not None:
                part.close()
