"""What the thread of the identifier calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from joint_id_core.data.recording import Recording
from joint_id_core.results.estimate import Estimate


@dataclass(frozen=True)
class Callbacks:
    """Callbacks of a worker, called from its threads."""

    estimated: Callable[[str, Estimate, int], None]  # joint, estimate, origin of its times in ns
    publish: Callable[[], None]  # publish what was estimated since the last call
    gone: Callable[[str], None]  # joint that is not in the samples any more
    silent: Callable[[str], None]  # joint whose samples do not come, as no others do
    problem: Callable[[str, str], None]  # kind, text
    completed: Callable[[Mapping[str, Recording]], Mapping[str, Recording]] = dict  # new samples, by joint
    now_s: Callable[[], float] = time.monotonic  # by it joints are silent; if it stands, none is
