"""Node `watch`: a page on 127.0.0.1 that shows the running graph."""

from __future__ import annotations

from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future

from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import SAMPLES
from joint_id_core.pages.live import ACTIONS, live_page
from joint_id_core.pages.server import Feed, PageServer, Query
from joint_id_msgs.msg import ArmPayload, JointParams, JointSamples
from joint_id_ros.diagnostics import Diagnostics
from joint_id_ros.identifier_client import IdentifierClient
from joint_id_ros.live_joints import LiveJoints
from joint_id_ros.live_nodes import LiveNodes
from joint_id_ros.options.watch import WatchOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.qos import LATEST
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.sources import Sources
from joint_id_ros.streams import Streams

SHOW_S = 0.5  # time between two states of the page
PACE_S = 0.05  # between two readings of the samples


class WatchNode(Node):
    """Serves a live page of estimates, alarms, the fit of the newest window and diagnostics."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.finished = Future()
        declare(self, WatchOptions)
        options = read(self, WatchOptions)
        self._joints, self._feed = LiveJoints(options.window_s), Feed()
        self._nodes, self._payload = LiveNodes(self.get_namespace(), options.identifier), ""
        self._client = IdentifierClient(self, options.identifier, tuple(ACTIONS))
        self._diagnostics = Diagnostics(self)
        page = live_page(f"joint_id {self.get_namespace()}".rstrip(" /"))
        self._server = PageServer(
            options.port,
            {"/": lambda _: page, "/report": self._joints.report},
            {"/joint": self._joints.plots},
            {f"/action/{name}": partial(self._act, name) for name in ACTIONS},
            self._feed,
        )
        self.create_subscription(JointParams, "joint_params", self._joints.put_params, LATEST, raw=True)
        self.create_subscription(ArmPayload, "payload", self._on_payload, LATEST)
        heard = self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=50))
        self._heard = heard.handle
        topics = {SAMPLES.name: JointSamples}
        self._sources = Sources(self, (), options.reliability, self._diagnostics, lambda *_: None)
        self.streams: Streams | None = Streams(
            self, topics, self._on_samples, self._sources, options.reliability, pace_s=PACE_S
        )
        self.create_timer(SHOW_S, self._show, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f"the page is at {self._server.address}")

    def close(self) -> None:
        """End the server and the subscription."""
        self._server.close()
        for part in (self.streams, self._sources):
            if part is not None:
                part.close()

    def _on_samples(self, _: str, message: RawMessage) -> None:
        if message.error is None:
            self._diagnostics.received(message.stamp_ns)
            self._joints.put_samples(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Take all that have arrived: one at each turn of the executor would be read seconds later."""
        taken: tuple[DiagnosticArray, object] | None = (message, None)
        with self._heard:
            while taken is not None:
                self._nodes.put(taken[0])
                taken = self._heard.take_message(DiagnosticArray, False)

    def _on_payload(self, message: ArmPayload) -> None:
        self._payload = message.message

    def _act(self, action: str, _: Query) -> str:
        answer = self._client.call(action)
        self.get_logger().info(f"{action}: {answer}")
        return answer

    def _show(self) -> None:
        try:
            self._joints.options = self._joints.options or self._client.options()
        except JointIdError as error:
            self._diagnostics.problem("options of the identifier", str(error))
        joints, nodes = self._joints.update(), self._nodes.rows()
        silent = [*self._joints.complaints, *self._nodes.complaints]
        self._feed.publish({"joints": joints, "nodes": nodes, "payload": self._payload, "silent": silent})
