"""ROS parameters of the identifier: the baselines of the joints, and what counts as a drift from them."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.online.drift import DriftOptions
from joint_id_core.options import option


@dataclass(frozen=True)
class BaselineOptions(DriftOptions):
    """Where baselines are kept, and the options of the drift monitor."""

    baseline_file: str = option(
        "", "file with the baselines of the joints, which set_baseline writes; empty: they end with the node"
    )
