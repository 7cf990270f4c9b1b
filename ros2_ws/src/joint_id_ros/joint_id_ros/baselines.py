"""Service `~/set_baseline` of the identifier, and the drift of its estimates from the baselines."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from rclpy.node import Node
from std_srvs.srv import Trigger

from joint_id_core.errors import JointIdError
from joint_id_core.online import baseline_file
from joint_id_core.online.drift import Drift, DriftMonitor
from joint_id_core.results.estimate import Estimate
from joint_id_ros.options.baselines import BaselineOptions

SERVICE = "~/set_baseline"


class Baselines:
    """The baselines of the joints of a node: set by a service, kept in a file, compared with every estimate.

    Args:
        node: the node that gets the service.
        good: returns the newest good estimate by joint.
        problem: reports a problem, given its kind and a text.
    """

    def __init__(
        self, node: Node, good: Callable[[], Mapping[str, Estimate]], problem: Callable[[str, str], None]
    ) -> None:
        self._node, self._good, self._problem = node, good, problem
        self._options = BaselineOptions()
        self._lock = threading.Lock()  # estimates come from several threads
        self._monitors: dict[str, tuple[int, DriftMonitor]] = {}  # with the origin of the times of the estimates
        node.create_service(Trigger, SERVICE, self._on_set)

    @property
    def joints(self) -> list[str]:
        """Names of the joints that have a baseline."""
        with self._lock:
            return sorted(self._monitors)

    def prepare(self, options: BaselineOptions) -> None:
        """Take the options, and read the baselines from the file; without a file those in use stay.

        Raises:
            JointIdError: the file is none of baselines, or they do not suit the options.
        """
        with self._lock:
            known = {joint: monitor.baseline for joint, (_, monitor) in self._monitors.items()}
            found = known | baseline_file.load(_path(options)) if options.baseline_file else known
            self._monitors = {joint: (0, _monitor(joint, baseline, options)) for joint, baseline in found.items()}
            self._options = options
        if found:
            self._node.get_logger().info(f"watching for drift from the baselines of {', '.join(sorted(found))}")

    def drifts(self, joint: str, estimate: Estimate, origin_ns: int) -> list[Drift]:
        """Return the parameters of a joint that have left its baseline; times of the estimate count from the origin."""
        with self._lock:
            if joint not in self._monitors:
                return []
            origin, monitor = self._monitors[joint]
            if origin != origin_ns:  # another run: what was found in the previous one ends
                monitor = _monitor(joint, monitor.baseline, self._options)
                self._monitors[joint] = origin_ns, monitor
            try:
                return list(monitor.update(estimate))
            except JointIdError as error:
                self._problem("no comparison with the baseline", f"joint {joint}: {error}")
                return []

    def _on_set(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the newest good estimate of every joint as its baseline; joints without one keep theirs."""
        try:
            response.message = self._set()
            response.success = True
        except JointIdError as error:
            response.message = str(error)
        self._node.get_logger().info(f"set_baseline: {response.message}")
        return response

    def _set(self) -> str:
        good = self._good()
        if not good:
            raise JointIdError("no good estimate yet: move the joints until one has CONVERGED, then ask again")
        with self._lock:
            new = {joint: (0, _monitor(joint, estimate, self._options)) for joint, estimate in good.items()}
            monitors = self._monitors | new
            if self._options.baseline_file:
                baseline_file.save(_path(self._options), {joint: m.baseline for joint, (_, m) in monitors.items()})
            self._monitors = monitors
        file = self._options.baseline_file
        kept = f"written to {file}" if file else "kept until the node ends"
        return f"baseline of {', '.join(sorted(new))}: {kept}"


def _path(options: BaselineOptions) -> Path:
    return Path(options.baseline_file).expanduser()


def _monitor(joint: str, baseline: Estimate, options: BaselineOptions) -> DriftMonitor:
    try:
        return DriftMonitor(baseline, options)
    except JointIdError as error:
        raise JointIdError(f"joint {joint}: {error}") from None
