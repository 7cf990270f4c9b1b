"""ROS parameters of the live page."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.options import check, option, same_option
from joint_id_ros.options.reading import ReadingOptions


@dataclass(frozen=True)
class WatchOptions:
    """Where the page is, and what it shows."""

    port: int = option(8765, "port of the page on 127.0.0.1; 0 takes any that is free", lower=0, upper=65535)
    identifier: str = option(
        "identifier", "name of the identifier whose estimates are shown and whose services are used"
    )
    window_s: float = option(4.0, "samples that are shown beside their predictions", "s", 0.5, 60.0)
    reliability: str = same_option(ReadingOptions, "reliability")

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class WatchFleetOptions:
    """Where the page of a fleet is."""

    port: int = same_option(WatchOptions, "port")

    def __post_init__(self) -> None:
        check(self)
