"""Node `identifier`: identifies the physical parameters of each joint from aligned samples."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import suppress
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType

from joint_id_core.alignment.joining import StampOrder
from joint_id_core.alignment.source_watch import RATE, SourceEvent
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import SAMPLES
from joint_id_core.online.options import OnlineOptions
from joint_id_core.results.estimate import Estimate
from joint_id_core.stored.knowledge import StoredKnowledge
from joint_id_msgs.msg import JointSamples
from joint_id_ros.arm_load_errors import ArmLoadErrors
from joint_id_ros.baselines import Baselines
from joint_id_ros.callbacks import Callbacks
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.ending import SILENT_S, Ending
from joint_id_ros.estimate_bytes import to_values
from joint_id_ros.identifier_health import IdentifierHealth
from joint_id_ros.identifier_setup import IdentifierSetup
from joint_id_ros.knowledge_services import serve
from joint_id_ros.latest_estimates import LatestEstimates
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.options.baselines import BaselineOptions
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.options.load import LoadOptions
from joint_id_ros.options.node_list import NODES
from joint_id_ros.options.reading import BagReadingOptions
from joint_id_ros.parameters import read
from joint_id_ros.preparation import Preparation
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.sources import Sources
from joint_id_ros.streams import READ_S, Streams
from joint_id_ros.worker import Worker, gathered_s

START_S = 0.05  # period of the checks, at a start without a lifecycle manager, whether the kernels are there
END_S = 0.5  # period of the checks whether the node to end with has gone


class IdentifierNode(ManagedNode):
    """Identifies every joint from its samples in a thread, and publishes the latest estimates."""

    def __init__(self, **how: Any) -> None:
        super().__init__("identifier", *NODES["identifier"], **how)
        self._setup = IdentifierSetup(IdentifierOptions(), OnlineOptions())
        self._preparation: Preparation | None = None
        self._worker: Worker | None = None
        self._sources: Sources | None = None
        self._order, self._latest = StampOrder(), LatestEstimates(self)
        self._fits, self._report = Counter[str](), IdentifierHealth()
        self._heard_s: float | None = None  # when the last sample came
        self._ending = Ending(self)
        self._diagnostics = Diagnostics(self, self._health, "joint_samples")
        self._knowledge = StoredKnowledge(self._diagnostics.problem)
        self._load_errors = ArmLoadErrors(self, self._diagnostics.problem)
        serve(self, self._knowledge, self._renew)
        self._baselines = Baselines(self, self._knowledge.good, self._diagnostics.problem)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(END_S, self._end_with_its_leader, clock=steady)
        auto = bool(self.get_parameter("autostart").value)
        self._starter = self.create_timer(START_S, self._start_by_itself, clock=steady, autostart=auto)

    def _start_by_itself(self) -> None:
        """Configure and activate as soon as the kernels are there; diagnostics and signals are served meanwhile."""
        if self._configured or self._worker is not None:
            self._starter.cancel()  # a lifecycle manager did it
            return
        with suppress(JointIdError):  # `start` gets the same error and reports it
            preparation = self._prepared()
            self.not_ready = f"not configured yet: {preparation.text}"
            if not preparation.done:
                return
        self._starter.cancel()
        if not self.start() and self.get_parameter("end_with").value:
            self.finished.set_result(JointIdError(self.not_ready))

    def _prepared(self) -> Preparation:
        """Return the preparation of what the parameters say; it is begun if there is none yet."""
        setup = IdentifierSetup(read(self, IdentifierOptions), read(self, OnlineOptions))
        if self._preparation is None or setup != self._setup:
            self._setup, self._preparation = setup, None
            self._preparation = setup.prepare()
            self.get_logger().info(self._preparation.text)
        return self._preparation

    def prepare(self) -> None:
        """Check all parameters, and compile or load every kernel, so that no fit waits for a compilation."""
        self._baselines.prepare(read(self, BaselineOptions))
        try:
            self._prepared().wait(self._diagnostics.report_if_due)
        finally:
            self._preparation = None
        self._knowledge.open(self._setup.model.state_file)
        self._load_errors.open(read(self, LoadOptions))

    def begin(self) -> None:
        """Subscribe, publish what is known of an earlier run, and start the threads."""
        self._order = StampOrder()
        reading, topics = read(self, BagReadingOptions), {SAMPLES.name: JointSamples}
        how, pace_s = reading.reliability, max(READ_S, gathered_s(self._setup.online.hop_s))
        self._begin_run()
        self._sources = Sources(self, topics, how, self._diagnostics, self._on_source, reading.recorded)
        self.streams = Streams(self, topics, self._on_samples, self._sources, how, self._on_batch, pace_s, self._ready)
        self.get_logger().info(f"identifying {self._setup.model.model} with {self._setup.model.estimator}")

    def _begin_run(self) -> None:
        options, hop_s = self._setup.model, self._setup.online.hop_s
        self._knowledge.begin(options.joints, self._setup.possible)
        restored = {j: to_values(j, r.newest, r.estimate, r.origin_ns) for j, r in self._knowledge.restored.items()}
        self._latest.begin(restored)
        told = self._on_estimate, self._latest.publish, self._on_gone, self._latest.drop, self._diagnostics.problem
        make, reading = partial(self._setup.begin, self._knowledge), read(self, BagReadingOptions)
        now_s = (lambda: 0.0) if reading.end_with else self.now_s  # the last estimates stay
        callbacks, known = Callbacks(*told, self._load_errors.attached, now_s), tuple(restored)
        self._worker = Worker(make, options.joints, options.expected, callbacks, hop_s, known, reading.recorded)

    def _renew(self) -> None:
        """Begin a new run with what is known now."""
        if self._worker is not None:
            self._worker.stop()
            self._begin_run()

    def close(self) -> None:
        """End the subscription and the threads."""
        for part in (self.streams, self._sources):
            if part is not None:
                part.close()
        if self._worker is not None:
            self._worker.stop()
        self._knowledge.store.flush()
        self.streams = self._sources = self._worker = None

    def _on_samples(self, topic: str, message: RawMessage) -> None:
        if self._worker is None:
            return
        self._heard_s = time.monotonic()
        self._diagnostics.received(message.stamp_ns)
        try:
            if message.error is not None:
                raise message.error
            if self._order.restarts(SAMPLES.name, message.stamp_ns):
                self._restart(self._worker, f"{SAMPLES.name}: time jumped back")
        except JointIdError as error:
            self._diagnostics.problem("message left out", str(error))
            return
        self._worker.add(message)

    def _ready(self) -> bool:
        return self._worker is None or not self._worker.full

    def _on_batch(self) -> None:
        if self._worker is not None:
            self._worker.wake()

    def _on_source(self, topic: str, event: SourceEvent) -> None:
        if event.kind == RATE and self._worker is not None:
            self._restart(self._worker, event.text)

    def _restart(self, worker: Worker, why: str) -> None:
        self._diagnostics.problem("restart", f"{why}: identification starts anew")
        worker.restart()
        self._knowledge.forget_run()

    def _on_estimate(self, joint: str, estimate: Estimate, origin_ns: int) -> None:
        """Take an estimate, to be published; called from the worker's threads."""
        good = self._knowledge.add(joint, estimate, origin_ns)
        drifts = self._baselines.drifts(joint, estimate, origin_ns)
        self._latest.put(joint, to_values(joint, estimate, good, origin_ns, drifts))
        self._fits[estimate.status.value] += 1

    def _on_gone(self, joint: str) -> None:
        """Take back what was published of a joint that disappeared; called from the worker's thread."""
        self._knowledge.gone(joint)
        self._latest.drop(joint)

    def _end_with_its_leader(self) -> None:
        """End when the node that this one follows has gone and all its samples have been used."""
        silent = self._heard_s is None or time.monotonic() - self._heard_s > SILENT_S
        if not self._ending.due(self.get_parameter("end_with").value, self._heard_s is not None) or not silent:
            return
        if self._worker is None or (self._worker.idle and self._sources is not None and not self._sources.published):
            self._latest.wait()
            self.finished.set_result(None)

    def _health(self) -> Health:
        worker, sources = self._worker, self._sources
        if self.not_ready or worker is None or sources is None:
            level = DiagnosticStatus.ERROR if self._preparation is None else DiagnosticStatus.WARN
            return Health(level, self.not_ready or "stopped")
        return self._report.report(self._latest.newest, self._fits, worker, sources, self._knowledge, self._baselines)
