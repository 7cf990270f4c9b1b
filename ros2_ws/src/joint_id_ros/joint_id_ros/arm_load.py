"""The load of the arm in the filter: its description, the load in the samples, and what is missing or wrong for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from rclpy.node import Node

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.arm.description import Description
from joint_id_core.arm.gravity_watch import GravityWatch
from joint_id_core.arm.online_load import OnlineLoad, with_unknown_load
from joint_id_core.errors import JointIdError
from joint_id_ros.description_source import DescriptionSource
from joint_id_ros.options.load import LoadOptions


class ArmLoad:
    """Adds the load of the arm to samples, if the options ask for it.

    Without a description that can be used, samples pass at once, and their load is NaN: not known. A description that
    comes later is used from then on, and a new one takes its place.
    """

    def __init__(
        self, node: Node, options: LoadOptions, inputs: InputOptions, max_gap: float, tell: Callable[[str, str], None]
    ) -> None:
        """Read the description, or subscribe to it.

        Args:
            node: the filter.
            options: where the description is.
            inputs: what the effort of the samples is.
            max_gap: longest gap that is bridged, in periods.
            tell: takes the kind and the text of a problem.

        Raises:
            JointIdError: a file that is no description of a robot, an effort without the part of gravity but a load
                with it, or Pinocchio is not installed.
        """
        self._options, self._max_gap, self._tell = options, max_gap, tell
        self._load: OnlineLoad | None = None
        self._gravity: GravityWatch | None = None
        self._left: list[AlignedSamples] = []  # samples that waited for a load of an earlier description
        self._joints: tuple[str, ...] = ()  # of the newest samples
        if not options.given:
            return
        if inputs.effort_source == "gravity_free_torque" and np.any(options.base_gravity):
            raise JointIdError(
                "the effort is without the part that holds gravity (gravity_free_torque), so the load must be, too: "
                "set base_gravity to [0.0, 0.0, 0.0]"
            )
        self._source = DescriptionSource(node, options, self._use, tell)

    def _use(self, description: Description | None) -> None:
        if self._load is not None:
            self._left += self._load.release()
        self._load = self._gravity = None
        if description is not None:
            self._load, self._gravity = OnlineLoad(description, self._max_gap), GravityWatch(description)

    def add(self, samples: Iterable[AlignedSamples]) -> list[AlignedSamples]:
        """Take samples and return those that need not wait for their load any more."""
        if not self._options.given:
            return list(samples)
        done, self._left = self._left, []
        for part in samples:
            self._joints = tuple(part.joints)
            done += self._load.add(part) if self._load is not None else [with_unknown_load(part)]
            if self._gravity is not None and self._gravity.add(part):
                self._tell("gravity", self._gravity.doubt)
        return done

    def release(self) -> list[AlignedSamples]:
        """Return all samples that wait for their load, and begin anew."""
        return self._load.release() if self._load is not None else []

    @property
    def latency(self) -> float:
        """Time in s that samples wait here; NaN until the sampling period is known."""
        return self._load.latency if self._load is not None else 0.0

    @property
    def complaint(self) -> str:
        """Why the load is not known, or doubted; empty if it is known, or not asked for."""
        if not self._options.given:
            return ""
        if self._load is None:
            why = self._source.refused or f"no description on {self._source.name} yet"
            return f"the load of the arm is not known: {why}"
        if self._load.missing and self._joints:
            return (
                f"the load of the arm is not known: no position of {', '.join(self._load.missing)}, which the "
                f"description moves (there are {', '.join(self._joints)}): joints are found by name; make one that "
                "stands still fixed in a copy of the description"
            )
        return self._gravity.doubt if self._gravity is not None else ""

    @property
    def values(self) -> dict[str, object]:
        """Values for the diagnostics."""
        if not self._options.given:
            return {}
        known = "not known" if self._load is None or self._load.missing else f"of {self._source.name}"
        without = "; ".join(f"{joint}: {why}" for joint, why in self._load.unloaded.items()) if self._load else ""
        return {"load": known, "without a load": without or "none"}
