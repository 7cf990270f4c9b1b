"""Node `identifier`: identifies the physical parameters of each joint from aligned samples."""

from __future__ import annotations

from collections import Counter

from diagnostic_msgs.msg import DiagnosticStatus

from joint_id_core.alignment.joining import StampOrder
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import SAMPLES
from joint_id_core.online.identifier import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples
from joint_id_ros import conversions as convert
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.parameters import read
from joint_id_ros.qos import LATEST
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.streams import Streams
from joint_id_ros.worker import Callbacks, Worker

SLOW_S = 3.0  # a fit that takes longer is reported


class IdentifierNode(ManagedNode):
    """Fits the model of every joint over sliding windows in a thread, and publishes the latest estimates."""

    def __init__(self) -> None:
        super().__init__("identifier", IdentifierOptions, OnlineOptions)
        self._model_options = IdentifierOptions()
        self._online_options = OnlineOptions()
        self._worker: Worker | None = None
        self._order = StampOrder()
        self._latest: dict[str, JointEstimate] = {}
        self._good: dict[str, tuple[int, Estimate]] = {}  # newest good estimate by joint, with the origin of its times
        self._fits: Counter[str] = Counter()
        self._diagnostics = Diagnostics(self, self._health, "joint_samples")
        self._publisher = self.create_lifecycle_publisher(JointParams, "joint_params", LATEST)
        if self.get_parameter("autostart").value:
            self.start()

    def _begin_joint(self, joint: str, samples: Recording) -> OnlineIdentifier:
        """Build the identifier of a joint from its first samples."""
        options = self._model_options
        return self._make(joint, options.drive_in(samples))

    def _make(self, joint: str, drive: str) -> OnlineIdentifier:
        options = self._model_options
        return OnlineIdentifier(
            options.build(drive),
            options.settings(joint),
            self._online_options,
            options.solver,
        )

    def prepare(self) -> None:
        """Read the parameters and check all of them by building the identifiers."""
        self._model_options = read(self, IdentifierOptions)
        self._online_options = read(self, OnlineOptions)
        for joint in self._model_options.expected or ("",):
            try:
                self._check(joint)
            except JointIdError as error:
                raise JointIdError(f"joint {joint}: {error}" if joint else str(error)) from None

    def _check(self, joint: str) -> None:
        """Check that the identifier of a joint can be built with at least one of the possible drive signals."""
        errors = {}
        for drive in self._model_options.drives:
            try:
                self._make(joint, drive)
                return
            except JointIdError as error:
                errors[drive] = error
        told = "current" if "k_t" in self._model_options.values(joint) else "torque"  # drive that the user means
        raise errors.get(told) or next(iter(errors.values()))

    def begin(self) -> None:
        """Start the thread and subscribe; estimates of an earlier run are forgotten."""
        self._order = StampOrder()
        self._latest.clear()
        self._good.clear()
        callbacks = Callbacks(self._on_estimate, self._diagnostics.problem)
        options = self._model_options
        self._worker = Worker(self._begin_joint, options.joints, options.expected, callbacks)
        self.streams = Streams(self, {SAMPLES.name: JointSamples}, self._on_samples)
        self.get_logger().info(f"identifying {options.model} with {options.estimator}")

    def close(self) -> None:
        """End the subscription and the thread."""
        if self.streams is not None:
            self.streams.close()
            self.streams = None
        if self._worker is not None:
            self._worker.stop()
            self._worker = None

    def _on_samples(self, topic: str, message: RawMessage) -> None:
        if self._worker is None:
            return
        self._diagnostics.received(message.stamp_ns)
        try:
            if message.error is not None:
                raise message.error
            restart = self._order.restarts(SAMPLES.name, message.stamp_ns)
        except JointIdError as error:
            self._diagnostics.problem("message left out", str(error))
            return
        if restart:
            self._diagnostics.problem("restart", f"{SAMPLES.name}: time jumped back: identification starts anew")
            self._worker.restart()
        self._worker.add(message)

    def _on_estimate(self, joint: str, estimate: Estimate, origin_ns: int) -> None:
        """Publish an estimate; called from the worker's thread."""
        if estimate.converged:
            self._good[joint] = origin_ns, estimate
        origin, good = self._good.get(joint, (origin_ns, None))
        if origin != origin_ns:  # it belongs to the previous run, perhaps of another robot
            good = None
        self._latest[joint] = convert.to_estimate_message(joint, estimate, good, origin_ns)
        self._fits[estimate.status.value] += 1
        message = JointParams(joints=[self._latest[name] for name in sorted(self._latest)])
        newest = max(message.joints, key=lambda j: convert.nanoseconds(j.window_end))
        message.header.stamp = newest.window_end
        self._publisher.publish(message)

    def _health(self) -> Health:
        if self.not_ready or self._worker is None:
            return Health(DiagnosticStatus.ERROR, self.not_ready or "stopped")
        values: dict[str, object] = {f"fits: {status}": n for status, n in sorted(self._fits.items())}
        values["backlog"] = self._worker.backlog
        bad = []
        for name, joint in sorted(self._latest.copy().items()):
            values[f"{name}: solve time [s]"] = f"{joint.solve_time:.4f}"
            values[f"{name}: status"] = joint.message
            found = sum(p.verdict == p.ESTIMATED for p in joint.parameters)
            if joint.age > 0.0:
                values[f"{name}: age of the parameters [s]"] = f"{joint.age:.3f}"
            values[f"{name}: estimated"] = f"{found} of {len(joint.free)} parameters"
            if joint.status != JointEstimate.CONVERGED:
                bad.append(f"{name}: {joint.message}")
        if self._worker.busy_s > SLOW_S:
            bad.append(f"a fit takes {self._worker.busy_s:.0f} s so far (the first one of a model compiles it)")
        level = DiagnosticStatus.WARN if bad else DiagnosticStatus.OK
        return Health(level, "; ".join(bad) or f"identified {len(self._latest)} joints", values)
