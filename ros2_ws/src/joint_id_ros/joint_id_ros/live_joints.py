"""Joints of a live page from what the nodes publish: estimates, and samples with their predictions."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from rclpy.serialization import deserialize_message

from joint_id_core.data.instants import NANO
from joint_id_core.data.quantities import with_deviation
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations
from joint_id_core.pages.contents import Contents
from joint_id_core.pages.live import LiveView, Seen
from joint_id_core.pages.report import report
from joint_id_core.pages.server import Query
from joint_id_core.results.estimate import Predictions
from joint_id_core.results.status import Status
from joint_id_core.validation.prediction import predicted
from joint_id_msgs.msg import JointEstimate, JointParams
from joint_id_ros.conversions import to_estimate
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.samples import to_recordings

RESTING = (Status.NO_MOTION, Status.TOO_SHORT)
SILENT_S = 2.0  # without samples and estimates, from which their source counts as silent


class LiveJoints:
    """What the pages of a server show of the joints; threads may call it.

    Attributes:
        options: of the identifier; None as long as they are not known.
    """

    def __init__(self, window_s: float) -> None:
        self.options: IdentifierOptions | None = None
        self._window_ns = int(window_s * NANO)
        self._view, self._lock = LiveView(), threading.Lock()
        self._samples: deque[RawMessage] = deque()
        self._params = b""
        self._published_s = self._heard_s = time.monotonic()  # when estimates came last, and estimates or samples

    def put_params(self, data: bytes) -> None:
        """Take the newest message of estimates; it is read by `update`, so that one that is replaced costs nothing."""
        self._params = data

    def put_samples(self, message: RawMessage) -> None:
        """Take a sample of all joints, and forget those before the window."""
        with self._lock:
            self._heard_s = time.monotonic()
            if self._samples and message.stamp_ns < self._samples[-1].stamp_ns:
                self._samples.clear()
            self._samples.append(message)
            while message.stamp_ns - self._samples[0].stamp_ns > self._window_ns:
                self._samples.popleft()

    def update(self) -> list[dict[str, object]]:
        """Read the newest estimates and return the rows of the page."""
        data, self._params = self._params, b""
        now = time.monotonic()
        with self._lock:
            if data:
                joints = {one.joint: to_seen(one) for one in deserialize_message(data, JointParams).joints}
                self._view.take(joints)
                self._published_s = now
                self._heard_s = now if joints else self._heard_s  # without joints they are taken back
            order = self._samples[-1].name if self._samples else ()
            return self._view.joints(order, now - self._published_s)

    @property
    def complaints(self) -> list[str]:
        """That no samples come, if none do."""
        silent_s = time.monotonic() - self._heard_s
        return [f"No samples for {silent_s:.0f} s"] if silent_s > SILENT_S else []

    def plots(self, query: Query) -> dict[str, object]:
        """Return the plots of the joint `name`."""
        with self._lock:
            seen = self._view.seen(query.get("name", ""))
        window, told = self._window(seen)
        with self._lock:
            return {**self._view.plots(query["name"], window), "told": told}

    def report(self, query: Query) -> str:
        """Return the report of the newest estimate of the joint `joint` and of the newest window."""
        with self._lock:
            seen = self._view.seen(query.get("joint", ""))
        window, told = self._window(seen)
        estimate = replace(seen.estimate, predictions=window, notes=(*seen.estimate.notes, *seen.changes, *seen.drifts))
        recording = self._recording(seen.estimate.joint)
        return report(Contents(estimate, recording, why=(told,) if told else ()))

    def _window(self, seen: Seen) -> tuple[Predictions | None, str]:
        """Return what the newest estimate predicts of the newest samples, and why it is not there."""
        estimate, options, recording = seen.estimate, self.options, self._recording(seen.estimate.joint)
        if recording is None:
            return None, "No samples on joint_samples."
        if options is None or estimate.estimator != Innovations.name:
            return None, "The options of the identifier are not known yet, or its estimator makes no predictions."
        if estimate.status in RESTING:
            return None, estimate.message
        try:
            model = options.build(options.drive_in(recording))
            if set(model.parameter_names) != set(estimate.values):
                self.options = None  # it was started anew, with others
                return None, "The identifier has other options now."
            return predicted(model, recording, replace(estimate, cell=options.cell)), ""
        except JointIdError as error:
            return None, str(error)

    def _recording(self, joint: str) -> Recording | None:
        with self._lock:
            samples = list(self._samples)
        return to_recordings(samples, 0, "joint_samples").get(joint) if samples else None


def to_seen(message: JointEstimate) -> Seen:
    """Return what a page shows of a published estimate."""
    changes = tuple(
        f"{c.name} changed from {with_deviation(c.before, c.before_std_dev)} "
        f"to {with_deviation(c.after, c.after_std_dev)}"
        for c in message.changes
    )
    baselines: Mapping[str, float] = {d.name: d.baseline for d in message.drifts}
    return Seen(to_estimate(message), message.age, changes, tuple(d.text for d in message.drifts), baselines)
