"""ROS parameters of the sim, in addition to those of its motion."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.models import Electromechanical
from joint_id_core.options import check, option
from joint_id_core.simulation.plants import PLANTS


@dataclass(frozen=True)
class SimOptions:
    """The joint to simulate, and the signals to publish."""

    model: str = option(
        Electromechanical.name, "electromechanical: Model 3, voltage steps; harmonic_drive: Model 2, position control",
        choices=tuple(PLANTS),
    )  # fmt: skip
    joint: str = option("joint", "name of the joint")
    set: tuple[str, ...] = option((), 'values of the model\'s parameters, as "NAME=VALUE"; may change while it moves')
    rate: float = option(500.0, "samples a second", "Hz", 1.0, 1e4)
    duration: float = option(0.0, "time after which the node ends; 0: never", "s", 0.0, 1e7)
    seed: int = option(0, "seed of the noise", lower=0)
    noise: bool = option(True, "sensor noise and quantisation of a UR robot; false: exact values")
    publish_all_states: bool = option(
        True, "publish every state of the model (by default for electromechanical only); false: what a UR robot sends"
    )
    wait_subscribers: int = option(0, "start to move when this many subscribers listen on every topic", lower=0)

    def __post_init__(self) -> None:
        check(self)
