"""The end of a node that follows another one, such as the readers of a bag after its player."""

from __future__ import annotations

from rclpy.node import Node

SILENT_S = 1.0  # after this silence no message of a node that has gone is on its way any more


class Ending:
    """Notices when another node, the leader, has gone."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._seen = False

    def due(self, leader: str, heard: bool) -> bool:
        """Return whether the leader was there and has gone.

        Args:
            leader: its name, relative to the namespace of this node; "" for none.
            heard: whether its messages have come, so that it was there even if the graph never showed it.
        """
        if not leader:
            return False
        name = leader if leader.startswith("/") else _joined(self._node.get_namespace(), leader)
        there = name in (_joined(space, node) for node, space in self._node.get_node_names_and_namespaces())
        self._seen = self._seen or there or heard
        return self._seen and not there


def _joined(namespace: str, name: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"
