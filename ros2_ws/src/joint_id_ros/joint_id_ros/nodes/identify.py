"""Node `identify`: an action that identifies joints by a motion made for it. Nothing moves before the user's go."""

from __future__ import annotations

import os
import time
import traceback
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from std_srvs.srv import Trigger

from joint_id_core.errors import JointIdError
from joint_id_core.jobs.robot_file import robot_settings
from joint_id_msgs.action import Identify
from joint_id_ros.deferred_server import DeferredServer
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.identification import CancelledError, Identification, Phase
from joint_id_ros.identify_messages import expected, result
from joint_id_ros.identify_request import Request
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.options.identify import IdentifyOptions
from joint_id_ros.parameters import read
from joint_id_ros.robot_link import RobotLink
from joint_id_ros.running import SIGNALS

TICK_S = 0.02  # between two steps of a goal
TELL_S = 0.5  # between two feedbacks of the same phase
ALONE = "one identification at a time: wait for its result, or cancel it"


class IdentifyNode(ManagedNode):
    """Serves the action `identify` and the service `~/go`."""

    def __init__(self) -> None:
        super().__init__("identify", IdentifyOptions)
        self._options = IdentifyOptions()
        self._robot: RobotLink | None = None
        self._goal: ServerGoalHandle | None = None
        self._work: Identification | None = None
        self._told: tuple[Phase | None, float] = None, 0.0
        self._server = DeferredServer(
            self, Identify, "identify", lambda goal: Identify.Result(), goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted, cancel_callback=self._on_cancel,
        )  # fmt: skip
        self.create_service(Trigger, "~/go", self._on_go)
        self._diagnostics = Diagnostics(self, self._health)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK_S, self._tick, clock=steady)
        self.start_soon()

    def prepare(self) -> None:
        """Check the parameters."""
        self._options = read(self, IdentifyOptions)
        folder = Path(self._options.directory).absolute()
        if not (folder.is_dir() and os.access(folder, os.W_OK)):
            raise JointIdError(
                f"parameter directory = {folder}: no folder that can be written: make it, or give another"
            )
        if self._options.robot:
            robot_settings(self._options.robot, None, ())

    def begin(self) -> None:
        """Read the samples."""
        self._robot = RobotLink(self, self._options.silent_s)

    def close(self) -> None:
        """Stop what moves, close the recording, and give the goal its result."""
        if self._work is not None and self._robot is not None:
            if self._work.phase is Phase.MOVING:
                self._robot.halt()
            self._work.close()
            self._finish("abort", "the node was stopped")
        if self._robot is not None:
            self._robot.close()
            self._robot = None

    # --- what the user wants

    def _on_goal(self, goal: Any) -> GoalResponse:
        why = self.not_ready or (ALONE if self._work is not None else "")
        if why:
            self._diagnostics.problem("goal rejected", f"a goal was rejected: {why}")
        return GoalResponse.REJECT if why else GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        goal, options = handle.request, self._options
        assert self._robot is not None
        request = Request(
            tuple(goal.joints),
            goal.model,
            tuple(goal.set),
            goal.trajectory,
            goal.duration,
            options.robot,
            options.limits,
            options.reach,
            options.urdf,
        )
        name = f"identify_{datetime.now(UTC):%Y%m%d_%H%M%S_%f}"
        self._work = Identification(self._robot, request, Path(options.directory).absolute() / name, options.wait_s)
        self._steps, self._goal = self._work.steps(), handle
        handle.execute()  # says that it is being carried out

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._work is None:
            return CancelResponse.REJECT
        if self._work.phase is Phase.MOVING and self._robot is not None:
            self._robot.halt()  # at once: all else can wait
        self._work.cancelled = True
        return CancelResponse.ACCEPT

    def _on_go(self, _: Any, response: Any) -> Any:
        work = self._work
        response.success = work is not None and work.phase is Phase.WAITING_FOR_GO and not work.cancelled
        if work is not None and response.success:
            work.go = True
        response.message = "the motion begins" if response.success else "nothing waits for the go"
        return response

    # --- the course of a goal

    def _tick(self) -> None:
        if self._robot is None or self._work is None:
            return
        try:
            self._robot.look()
            next(self._steps)
            self._feed_back()
        except StopIteration:
            failed = {joint: why for joint, why in self._work.found.items() if isinstance(why, str)}
            text = "; ".join(filter(None, [self._work.text, *(f"{joint}: {why}" for joint, why in failed.items())]))
            self._finish("succeed" if self._work.estimates else "abort", text or "done")
        except CancelledError:
            self._finish("canceled", "cancelled")
        except JointIdError as error:
            self._finish("abort", str(error))
        except Exception:  # a fault of this program: rclpy would end the node
            self.get_logger().error(traceback.format_exc())
            self._robot.halt()
            self._work.close()
            self._finish("abort", "an internal error: see the log of the node")

    def _feed_back(self) -> None:
        work, goal = self._work, self._goal
        assert work is not None and goal is not None
        phase, told_s = self._told
        new = work.phase is not phase
        if not new and time.monotonic() - told_s < TELL_S:
            return
        self._told = work.phase, time.monotonic()
        feedback = Identify.Feedback(phase=int(work.phase), progress=work.progress, message=work.text)
        if new and work.phase is Phase.WAITING_FOR_GO and work.design is not None:
            feedback.expected = expected(work.design, work.request.model)
        goal.publish_feedback(feedback)

    def _finish(self, how: str, text: str) -> None:
        """End the goal: "succeed", "canceled" or "abort"."""
        work, goal = self._work, self._goal
        assert work is not None and goal is not None
        self._work, self._told = None, (None, 0.0)
        if how == "abort":
            self._diagnostics.problem("identification", text)
        if SIGNALS:  # the process ends: nobody would carry out what follows
            goal.abort()
            return
        found = result(work, text)

        def conclude(handle: ServerGoalHandle) -> Any:
            getattr(handle, "canceled" if work.cancelled else how)()
            return found

        self._server.notify_execute(goal, conclude)

    def _health(self) -> Health:
        if self.not_ready:
            return Health(DiagnosticStatus.ERROR, self.not_ready)
        if self._work is None:
            return Health(message="waiting for a goal")
        phase = self._work.phase.name.lower().replace("_", " ")
        return Health(message=phase, values={"phase": phase, "progress": f"{self._work.progress:.2f}"})
