"""One goal of the node `identify`, from the plan to the report, as steps between which the node does other things."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, TypeVar

from joint_id_core.design.design import Design
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.trajectory_watch import REST_S, TrajectoryWatch
from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate
from joint_id_msgs.action import Identify
from joint_id_ros.background_recorder import BackgroundRecorder
from joint_id_ros.child_process import ChildProcess
from joint_id_ros.identify_fit import Fitted, Spans, fit
from joint_id_ros.identify_plan import Plan, plan
from joint_id_ros.identify_request import Request
from joint_id_ros.robot_link import RobotLink

START_S = 10.0  # in which joints must move after the trajectory was sent, and samples must come
PAUSED_S = 5.0  # rest within a motion that was sent, after which it counts as ended
LONGEST_S, TIMES = 60.0, 3.0  # a motion that takes longer than so much more and so many times as long is another one
BRAKING_S = 3.0  # longest wait for rest after a stop
OFF = 0.1  # rad, rms, from which a motion is another one than the trajectory
T = TypeVar("T")
Steps = Generator[None, None, T]


class Phase(IntEnum):
    """Phases of the feedback."""

    PLANNING = Identify.Feedback.PLANNING
    WAITING_FOR_GO = Identify.Feedback.WAITING_FOR_GO
    MOVING = Identify.Feedback.MOVING
    FITTING = Identify.Feedback.FITTING


class CancelledError(Exception):
    """The goal was cancelled."""


@dataclass
class Identification:
    """The state of a goal.

    Attributes:
        robot: that moves.
        request: what is to be identified.
        base: path of its files, without an ending.
        wait_s: longest wait for the go.
        phase, progress, text: for the feedback.
        design: the motion, from the end of the phase PLANNING on.
        bag, page: files that were written.
        found: the result.
        cancelled, go: what the user wants.
    """

    robot: RobotLink
    request: Request
    base: Path
    wait_s: float
    phase: Phase = Phase.PLANNING
    progress: float = 0.0
    text: str = ""
    design: Design | None = None
    bag: Path | None = None
    page: Path | None = None
    found: Fitted = field(default_factory=dict)
    cancelled: bool = False
    go: bool = False
    _recorder: BackgroundRecorder | None = None
    _child: ChildProcess[Any] | None = None

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The estimates of the joints that could be fitted."""
        return {joint: one for joint, one in self.found.items() if not isinstance(one, str)}

    def steps(self) -> Steps[None]:
        """Do everything; between two steps, time passes.

        Raises:
            CancelledError: it was cancelled; the recording is closed.
            JointIdError: it cannot go on; what was recorded is kept.
        """
        self.text = "waiting for samples"
        yield from self._until(self.robot.positions, START_S, "no positions on link_states: is the driver running?")
        file, places = self.base.with_suffix(".csv"), dict(self.robot.positions())
        planned = yield from self._computed(ChildProcess(plan, self.request, places, file))
        self.design = design = planned.design
        joints = design.trajectory.names
        watch = self.robot.watch(joints)
        yield from self._wait_for_go(watch, design.notes)
        self._recorder = recorder = self.robot.record(self.base)
        try:
            watch = yield from self._motion(recorder, watch, planned)
        finally:
            recorder.stop()
            while not recorder.ended:
                yield
            self.bag = self.base if recorder.count else None
        self._require(recorder)
        spans, remark = self._spans(watch, design.trajectory, self.request.joints or joints)
        self.phase = Phase.FITTING
        page = self.base.with_suffix(".html")
        self.found = yield from self._computed(ChildProcess(fit, self.request, self.base, spans, page))
        self.page = page
        self.text = remark

    def close(self) -> None:
        """End everything at once; what was recorded is kept."""
        if self._child is not None:
            self._child.end()
        if self._recorder is not None:
            self._recorder.stop()
            self._recorder.wait()

    def _wait_for_go(self, watch: TrajectoryWatch, notes: tuple[str, ...]) -> Steps[None]:
        """Wait for the go, or for a motion after rest, which the user has started at the robot."""
        self.phase, self.progress = Phase.WAITING_FOR_GO, 0.0
        self.text = " ".join(["call the service go, or start the motion at the robot.", *notes])
        rested = False

        def begun() -> bool:
            nonlocal rested
            rested = rested or watch.rest_s > REST_S
            return self.go or (rested and watch.moving)

        late = f"no go within {self.wait_s:g} s (parameter wait_s): nothing was moved. Send the goal again"
        yield from self._until(begun, self.wait_s, late, samples=True)

    def _motion(self, recorder: BackgroundRecorder, watch: TrajectoryWatch, planned: Plan) -> Steps[TrajectoryWatch]:
        """Record the motion until it has ended, and return what was seen of it; stop it if anything is wrong."""
        self.phase, self.text = Phase.MOVING, "the recording begins"
        try:
            yield from self._until(lambda: recorder.count or recorder.ended, START_S, "nothing could be recorded")
            self._require(recorder)
            patience, trajectory = self.wait_s, planned.design.trajectory
            if self.go:
                watch = self.robot.watch(trajectory.names)
                patience = yield from self._begin(watch, planned)
            self.text = "moving, and recording"
            while not self._over(watch, trajectory, patience):
                self._require(recorder)
                self.progress = min(1.0, watch.motion_s / trajectory.duration)
                yield from self._pause(samples=True)
        except (CancelledError, JointIdError) as error:
            if isinstance(error, JointIdError):  # a cancel was passed on when it came
                self.robot.halt()
            end = time.monotonic() + BRAKING_S  # what the joints do until they rest belongs to the recording
            while watch.moving and time.monotonic() < end and self.robot.positions():
                yield
            raise
        return watch

    def _begin(self, watch: TrajectoryWatch, planned: Plan) -> Steps[float]:
        """Send the trajectory, wait until the joints move, and return how long they may rest before they go on."""
        if self.cancelled:
            raise CancelledError
        readers = self.robot.send(planned.message)
        if readers:
            late, patience = "the joints do not move: the diagnostics of the node that reads it say why", PAUSED_S
        else:
            late, patience = (
                "the joints do not move: start the motion at the robot, or a node that reads it",
                self.wait_s,
            )
        self.text = f"the trajectory was sent to joint_trajectory, which {readers or 'no'} node reads"
        yield from self._until(lambda: watch.moving, START_S if readers else self.wait_s, f"{self.text}; {late}", True)
        return patience

    @staticmethod
    def _over(watch: TrajectoryWatch, trajectory: Trajectory, patience: float) -> bool:
        """Return whether the motion has ended.

        Raises:
            JointIdError: it ended early, or is another one that goes on.
        """
        if watch.paused(trajectory) and (watch.matched(trajectory)[1] < OFF or watch.rest_s > patience):
            return True
        if watch.rest_s > patience:
            raise JointIdError(
                f"the motion ended after {watch.motion_s:.1f} s of {trajectory.duration:g} s: was the robot stopped?"
            )
        if watch.motion_s > LONGEST_S + TIMES * trajectory.duration:
            raise JointIdError(f"the joints still move after {watch.motion_s:.0f} s: this is another motion")
        return False

    @staticmethod
    def _require(recorder: BackgroundRecorder) -> None:
        """Raise JointIdError if the recording has failed."""
        if recorder.problem:
            raise JointIdError(recorder.problem)

    @staticmethod
    def _spans(watch: TrajectoryWatch, trajectory: Trajectory, joints: Sequence[str]) -> tuple[Spans, str]:
        """Return the instants in s between which each joint followed its part of the trajectory, and a remark."""
        begin, off = watch.matched(trajectory)
        if off > OFF:
            remark = f"the motion is not the trajectory (rms {off:.2g} rad apart), so all of it was fitted"
            return dict.fromkeys(joints), remark
        moves = {joint: trajectory.moves(joint) for joint in joints}
        return {joint: (begin + first, begin + last) for joint, (first, last) in moves.items()}, ""

    def _computed(self, child: ChildProcess[T]) -> Steps[T]:
        """Wait for a computation, and return what it gives."""
        self._child = child
        try:
            while not (found := child.result()):
                self.progress, self.text = child.share, child.text
                yield from self._pause(samples=False)
            return found[0]
        finally:
            child.end()
            self._child = None

    def _until(
        self, condition: Callable[[], object], longest_s: float | None, late: str, samples: bool = False
    ) -> Steps[None]:
        """Let time pass until a condition holds.

        Raises:
            JointIdError: with the text `late`, after `longest_s`.
        """
        end = None if longest_s is None else time.monotonic() + longest_s
        while not condition():
            if end is not None and time.monotonic() > end:
                raise JointIdError(late)
            yield from self._pause(samples)

    def _pause(self, samples: bool) -> Steps[None]:
        """Let time pass.

        Raises:
            CancelledError: the goal was cancelled.
            JointIdError: `samples` are needed and do not come any more.
        """
        yield
        if self.cancelled:
            raise CancelledError
        if samples and not self.robot.positions():
            raise JointIdError(
                f"no samples on link_states for {self.robot.silent_s:g} s: is the driver running, and connected to the "
                "robot?"
            )
