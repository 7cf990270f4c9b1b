"""A recording that goes on in a thread of its own, so that no other callback of a node waits for its disk."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from joint_id_core.errors import JointIdError
from joint_id_ros.recorder import Recorder, drain

POLL_S = 0.05  # longest time until the end of a recording is noticed


class BackgroundRecorder:
    """Records topics from now on, until `stop`.

    Args:
        node: in whose context and with whose names the topics are.
        output: bag directory to create.
        topics: relative or absolute names.

    Attributes:
        output: the bag.
        problem: why the recording ended by itself; "" if it did not.
    """

    def __init__(self, node: Node, output: Path, topics: Sequence[str]) -> None:
        self.output, self.problem = output, ""
        self._recorder = Recorder(output, [node.resolve_topic_name(topic) for topic in topics], context=node.context)
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self._recorder)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def count(self) -> int:
        """Number of messages written."""
        return self._recorder.count

    @property
    def ended(self) -> bool:
        """Whether all is written and the bag is closed, or the recording failed."""
        return not self._thread.is_alive()

    def stop(self) -> None:
        """Write what has arrived and close the bag, without waiting for it: see `ended`."""
        self._stop.set()

    def wait(self) -> None:
        """Wait until the recording has ended."""
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._executor.spin_once(timeout_sec=POLL_S)
            drain(self._recorder, self._executor)
        except JointIdError as error:
            self.problem = str(error)
        except ExternalShutdownException:
            pass  # the process ends
        try:
            self._recorder.close()
        except JointIdError as error:
            self.problem = self.problem or str(error)
        self._executor.shutdown()
        self._recorder.destroy_node()
