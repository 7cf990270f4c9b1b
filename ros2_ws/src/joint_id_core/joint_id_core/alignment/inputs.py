"""Meaning and units of the numbers in the filter's raw topics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.errors import JointIdError
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.options import check, option

LINK_STATES = "link_states"
EFFORTS = ("current", "torque", "gravity_free_torque")
VELOCITIES = ("link", "motor_over_gear_ratio")


@dataclass(frozen=True)
class InputOptions:
    """Options that define the meaning of the raw topics."""

    effort_source: str = option(
        "",
        "what the effort in link_states is: motor current in A, joint torque in Nm at the link, or that torque "
        "without the part that holds gravity (identify it with a model without gravity); may be left empty, which "
        "means current, unless link_states is remapped to a topic of another name",
        choices=("", *EFFORTS),
    )
    velocity_source: str = option(
        "link",
        "what the velocity in link_states is: that of the link, or that of the motor divided by the gear ratio, as "
        "UR robots report it",
        choices=VELOCITIES,
    )
    gear_ratio: float = option(
        GEAR_RATIO,
        "gear ratio by which a joint torque is brought to the motor shaft, and motor_over_gear_ratio as well",
        "1",
        1e-6,
        1e5,
    )
    join_wait_s: float = option(
        1.0,
        "how long a topic is awaited before it counts as not measured; one that has come is awaited four times as long",
        "s",
        0.0,
        10.0,
    )

    def __post_init__(self) -> None:
        check(self)

    def for_topic(self, topic: str) -> InputOptions:
        """Return the options with a definite `effort_source`; link_states is read from `topic` (all remaps applied).

        On a topic called link_states the effort is by definition the current. A topic of another name comes from a
        foreign program, so the user must say what the effort is.

        Raises:
            JointIdError: another topic name, and `effort_source` is empty.
        """
        if self.effort_source:
            return self
        if topic.rsplit("/", 1)[-1] != LINK_STATES:
            raise JointIdError(
                f"parameter effort_source is empty, and {LINK_STATES} is read from {topic}: say what the effort there "
                f"is ({', '.join(EFFORTS)}). The driver of UR robots publishes currents or torques, depending on its "
                "version and settings, and a wrong choice makes every result wrong"
            )
        return replace(self, effort_source="current")

    def channels(self, raw: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Convert raw channels by name: motor quantities refer to the motor shaft afterwards.

        Raw `current` and `link_velocity` hold the values of link_states. Depending on the options they become `torque`
        and `motor_velocity`, unless another topic provides these directly.
        """
        channels = dict(raw)
        if self.effort_source != "current" and "current" in channels:
            torque = channels.pop("current") / self.gear_ratio
            channels.setdefault("torque", torque)
        if self.velocity_source != "link" and "link_velocity" in channels:
            velocity = channels.pop("link_velocity") * self.gear_ratio
            channels.setdefault("motor_velocity", velocity)
        return channels
