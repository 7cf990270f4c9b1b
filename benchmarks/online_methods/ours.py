"""The online identifier of the library, called like the other methods."""

from __future__ import annotations

import numpy as np
from peers.model2 import FREE, MODEL

from joint_id_core.data.recording import Recording
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate
from online_methods.common import PERIOD_S, Known, Signals

HOP_S = 0.1


class Online:
    """Estimates every `HOP_S`; nothing is known until the first one."""

    def __init__(self) -> None:
        self._identifier = OnlineIdentifier(MODEL, options=OnlineOptions(hop_s=HOP_S))
        self._count = 0
        self._last: Estimate | None = None

    def update(self, samples: Signals) -> None:
        """Take new samples."""
        time = PERIOD_S * np.arange(self._count, self._count + len(samples.q))
        self._count += len(samples.q)
        channels = {"link_position": samples.q, "motor_velocity": samples.w, "torque": samples.torque}
        self._last = self._identifier.update(Recording(time, channels)) or self._last

    def known(self) -> Known:
        """What is known now."""
        nothing = dict.fromkeys(FREE, np.nan)
        if self._last is None or not self._last.converged:
            return Known(nothing, nothing)
        rows = [self._last[name] for name in FREE]
        return Known({p.name: p.value for p in rows}, {p.name: p.std_dev for p in rows})
