"""Services `~/save`, `~/load` and `~/reset` of the identifier."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from joint_id_core.errors import JointIdError
from joint_id_core.stored.knowledge import StoredKnowledge


def serve(node: Node, knowledge: StoredKnowledge, renew: Callable[[], None]) -> None:
    """Create the services; every answer is a sentence. `renew` begins a new run with what is known then."""

    def answer(name: str, action: Callable[[], str], new_run: bool, _: Any, response: Any) -> Any:
        try:
            response.message, response.success = action(), True
        except JointIdError as error:
            response.message, response.success = str(error), False
        if new_run and response.success:
            renew()
        node.get_logger().info(f"{name}: {response.message}")
        return response

    actions = {"save": (knowledge.save, False), "load": (knowledge.load, True), "reset": (knowledge.reset, True)}
    for name, (action, new_run) in actions.items():
        node.create_service(Trigger, f"~/{name}", partial(answer, name, action, new_run))
