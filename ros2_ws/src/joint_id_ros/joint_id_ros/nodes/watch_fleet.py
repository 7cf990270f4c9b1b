"""Node `watch_fleet`: a page on 127.0.0.1 that shows the joints of all robots in the graph."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future

from joint_id_core.pages.fleet import fleet_page
from joint_id_core.pages.server import Feed, PageServer
from joint_id_ros.diagnostics import Diagnostics
from joint_id_ros.live_fleet import LiveFleet
from joint_id_ros.live_nodes import LiveNodes
from joint_id_ros.options.watch import WatchFleetOptions
from joint_id_ros.parameters import declare, read

SHOW_S = 1.0  # time between two states of the page


class WatchFleetNode(Node):
    """Serves a live page with a row for each robot and each joint."""

    def __init__(self) -> None:
        super().__init__("watch_fleet")
        self.finished, self.streams = Future(), None
        declare(self, WatchFleetOptions)
        self._feed, self._nodes = Feed(), LiveNodes()
        self._fleet = LiveFleet(self, self._nodes)
        self._diagnostics = Diagnostics(self)
        page = fleet_page("joint_id: all robots")
        port = read(self, WatchFleetOptions).port
        self._server = PageServer(port, {"/": lambda _: page}, {"/joint": self._fleet.joint}, {}, self._feed)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._nodes.put, QoSProfile(depth=1000))
        self.create_timer(SHOW_S, self._show, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f"the page is at {self._server.address}")

    def close(self) -> None:
        """End the server."""
        self._server.close()

    def _show(self) -> None:
        self._feed.publish(self._fleet.update())
