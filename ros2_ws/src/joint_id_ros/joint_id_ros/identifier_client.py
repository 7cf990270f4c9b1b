"""Services of an identifier that another node uses: its actions, and the options that it was started with."""

from __future__ import annotations

import threading
import time
from dataclasses import fields

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import Trigger

from joint_id_core.errors import JointIdError
from joint_id_ros.options.identifier import IdentifierOptions

ANSWER_S = 10.0  # longest wait for an answer


class IdentifierClient:
    """Calls the services of an identifier.

    Args:
        node: whose executor handles the answers.
        name: of the identifier.
        actions: names of its services without arguments.
    """

    def __init__(self, node: Node, name: str, actions: tuple[str, ...]) -> None:
        self._name = name
        self._actions = {action: node.create_client(Trigger, f"{name}/{action}") for action in actions}
        self._parameters = node.create_client(GetParameters, f"{name}/get_parameters")
        self._asked: Future | None = None
        self._asked_s = 0.0

    def call(self, action: str) -> str:
        """Call a service and return what it answers. Other threads than that of the executor may call this.

        Raises:
            JointIdError: the identifier is not there, does not answer, or refuses.
        """
        client = self._actions[action]
        if not client.service_is_ready():
            raise JointIdError(f"no node offers {client.srv_name}: is the identifier {self._name} running?")
        done, future = threading.Event(), client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        if not done.wait(ANSWER_S):
            raise JointIdError(f"{client.srv_name} did not answer within {ANSWER_S:g} s")
        answer = future.result()
        if not answer.success:
            raise JointIdError(answer.message)
        return str(answer.message)

    def options(self) -> IdentifierOptions | None:
        """Return the options of the identifier; None as long as it has not answered. Call it again later then."""
        names = [f.name for f in fields(IdentifierOptions)]
        lost = self._asked is not None and time.monotonic() - self._asked_s > ANSWER_S  # it ended meanwhile
        if (self._asked is None or lost) and self._parameters.service_is_ready():
            self._asked, self._asked_s = (
                self._parameters.call_async(GetParameters.Request(names=names)),
                time.monotonic(),
            )
        if self._asked is None or not self._asked.done():
            return None
        answer, self._asked = self._asked.result(), None
        known = {n: v for n, v in zip(names, answer.values, strict=False) if v.type != ParameterType.PARAMETER_NOT_SET}
        given = {n: parameter_value_to_python(v) for n, v in known.items()}
        lists = {n: tuple(text for text in v if text) for n, v in given.items() if isinstance(v, list)}
        return IdentifierOptions(**(given | lists))
