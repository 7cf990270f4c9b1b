"""Base class of the lifecycle nodes: parameters locked while in use, start without a manager, errors reported."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import fields
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.task import Future

from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError
from joint_id_core.options import check_value
from joint_id_ros.parameters import declare, from_ros
from joint_id_ros.running import spare_the_collector
from joint_id_ros.streams import Streams

START_S = 0.01  # after which a node starts by itself
SUCCESS, FAILURE, ERROR = (getattr(TransitionCallbackReturn, name) for name in ("SUCCESS", "FAILURE", "ERROR"))


class ManagedNode(LifecycleNode):
    """A lifecycle node whose work is in `prepare`, `begin` and `close`.

    Its parameters come from options dataclasses. A value outside the choices or the range of its option is rejected
    when it is set. While the node is configured, its parameters cannot be changed.
    """

    def __init__(self, name: str, *options: type, **how: Any) -> None:
        """Declare the parameters of the options; `how` is passed on to rclpy's node."""
        super().__init__(name, **how)
        self.finished = Future()
        self.streams: Streams | None = None
        self.not_ready = "not configured yet"  # why the node does nothing; "" while it works
        self._configured = False
        self._own = {f.name: f for cls in options for f in fields(cls)}
        for cls in options:
            declare(self, cls, read_only=False)
        self.add_on_set_parameters_callback(self._on_parameters)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    def prepare(self) -> None:
        """Read and check the parameters.

        Raises:
            JointIdError: a parameter is wrong; the node stays unconfigured.
        """
        raise NotImplementedError

    def begin(self) -> None:
        """Start working."""
        raise NotImplementedError

    def close(self) -> None:
        """Stop working and end threads; may be called more than once, and in every state."""
        raise NotImplementedError

    def remedy(self, error: JointIdError) -> str:
        """Return advice on an error of `prepare`."""
        return "set the parameter and configure again"

    def now_s(self) -> float:
        """Return the time in s of the node's clock: with `use_sim_time` that of `/clock`."""
        return float(self.get_clock().now().nanoseconds / NANO)

    def start(self) -> bool:
        """Configure and activate without a lifecycle manager; return whether both succeeded."""
        return self.trigger_configure() == SUCCESS and self.trigger_activate() == SUCCESS

    def start_soon(self) -> None:
        """Start as soon as the node spins, unless a lifecycle manager is to do it (parameter `autostart`)."""

        def start() -> None:
            timer.cancel()
            if self.get_parameter("autostart").value and not self._configured:
                self.start()

        timer = self.create_timer(START_S, start, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Check every parameter and lock the parameters."""
        result = self._step(self.prepare)
        if result == SUCCESS:
            self._configured, self.not_ready = True, "configured, not active"
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable the publishers, then start working."""
        super().on_activate(state)
        result = self._step(self.begin)
        if result == SUCCESS:
            self.not_ready = ""
            spare_the_collector()  # now all is loaded that stays
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working, then disable the publishers."""
        self._end("configured, not active")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unlock the parameters."""
        self._configured, self.not_ready = False, "not configured"
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop permanently."""
        self._end("shut down")
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to the state unconfigured."""
        self._end("not configured after an internal error: see the log")
        self._configured = False
        return SUCCESS

    def _end(self, why: str) -> None:
        self.not_ready = why
        self.close()

    def _step(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        """Run one step and return its result; log its exceptions, which rclpy would hide."""
        try:
            step()
        except JointIdError as error:
            self.not_ready = f"not configured: {error}"
            self.get_logger().error(f"{self.not_ready}; {self.remedy(error)}")
            return FAILURE
        except Exception:
            self.get_logger().error(traceback.format_exc())
            return ERROR
        return SUCCESS

    def _on_change_state(self, request: Any, response: Any) -> Any:
        """Answer a lifecycle manager; a transition that is not allowed in this state would end the node in rclpy."""
        try:
            return self._change_state(request, response)
        except rclpy_implementation.RCLError:
            _, label = self._state_machine.current_state
            asked = request.transition.label or request.transition.id
            self.get_logger().error(f"transition {asked} is not possible: the node is {label}")
            response.success = False
            return response

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Reject changes of parameters in use, and values that an option cannot have.

        Rules that involve several options are checked later, in `prepare`.
        """
        own = [p for p in changes if p.name in self._own]
        if self._configured and own:
            reason = f"{own[0].name} is in use: deactivate and clean up, set it, then configure and activate again"
            return SetParametersResult(successful=False, reason=reason)
        try:
            for p in own:
                check_value(self._own[p.name], from_ros(self._own[p.name], p.value))
        except JointIdError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)
