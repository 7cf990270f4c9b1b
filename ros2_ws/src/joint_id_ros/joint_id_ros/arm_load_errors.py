"""What the loads of the joints may be off by, for the identifier: prepared in a thread, so that no estimate waits."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from rclpy.node import Node

from joint_id_core.arm.description import Description
from joint_id_core.arm.online_errors import OnlineErrors
from joint_id_core.data.recording import Recording
from joint_id_ros.description_source import DescriptionSource
from joint_id_ros.options.load import LoadOptions


class ArmLoadErrors:
    """Adds them to samples as soon as there is a description; without one, samples stay as they are."""

    def __init__(self, node: Node, tell: Callable[[str, str], None]) -> None:
        """Prepare; `tell` takes the kind and the text of a problem."""
        self._node, self._tell = node, tell
        self._source: DescriptionSource | None = None
        self._errors: OnlineErrors | None = None
        self._wanted: Description | None = None

    def open(self, options: LoadOptions) -> None:
        """Read the description, or subscribe to it, in place of an earlier one.

        Raises:
            JointIdError: see `DescriptionSource`.
        """
        if self._source is not None:
            self._source.close()
        self._take(None)
        self._source = DescriptionSource(self._node, options, self._take, self._tell)

    def _take(self, description: Description | None) -> None:
        self._errors, self._wanted = None, description
        if description is not None:
            threading.Thread(target=self._prepare, args=(description,), name="load errors", daemon=True).start()

    def _prepare(self, description: Description) -> None:
        errors = OnlineErrors(description)
        if description is self._wanted:
            self._errors = errors

    def attached(self, recordings: Mapping[str, Recording]) -> Mapping[str, Recording]:
        """Return the newest samples of all joints with what their computed load may be off by."""
        errors = self._errors
        return recordings if errors is None else errors.attached(recordings)
