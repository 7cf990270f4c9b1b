"""An action server whose goals are carried out by a timer of its node."""

from __future__ import annotations

from typing import Any

from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle


class DeferredServer(ActionServer):
    """`goal_handle.execute()` says that a goal is being carried out; `notify_execute` with a callback gives its result.

    A callback that waits in between would keep the executor of rclpy busy: it runs coroutines that wait again and
    again.
    """

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Run the callback, if there is one, which sets the state of the goal and returns the result."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)
