"""ROS parameters of the nodes that read streams of samples: filter and identifier."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.options import check, option

RELIABLE, BEST_EFFORT = RELIABILITIES = ("reliable", "best_effort")


@dataclass(frozen=True)
class ReadingOptions:
    """How a node subscribes to its samples, and when it ends."""

    reliability: str = option(
        RELIABLE,
        "reliable: lost samples are sent again, and a best-effort publisher is not read; best_effort: every publisher "
        "is read, and lost samples stay lost",
        choices=RELIABILITIES,
    )
    end_with: str = option(
        "", "name of the node with which this one ends, as soon as everything is published; empty: it does not end"
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class BagReadingOptions(ReadingOptions):
    """How a node subscribes to samples that may come from a bag, which can be played faster than the node is."""

    recorded: bool = option(
        False, "the samples come from a bag: no sample and no estimate is left out, and who is slow holds the player up"
    )


@dataclass(frozen=True)
class FilterReadingOptions(BagReadingOptions):
    """How the filter subscribes, and when it begins and ends."""

    wait_subscribers: int = option(0, "start to read when this many subscribers listen on joint_samples", lower=0)
