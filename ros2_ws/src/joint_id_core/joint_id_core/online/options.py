"""Options of the online identifier."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.options import check, option


@dataclass(frozen=True)
class OnlineOptions:
    """Options of the online identifier."""

    window_s: float = option(2.0, "length of the window that is fitted", "s", lower=0.1, upper=600.0)
    hop_s: float = option(0.5, "time between two estimates", "s", lower=0.001, upper=600.0)
    memory_s: float = option(
        60.0, "time of motion after which what was seen is forgotten; 0 fits every window by itself", "s",
        lower=0.0, upper=1e6,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)
