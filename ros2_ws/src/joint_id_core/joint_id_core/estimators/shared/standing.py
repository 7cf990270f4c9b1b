"""Friction of a link that goes nowhere.

A link that others shake, or whose motor winds up the gear, yields by parts of a milliradian and does not slide. What
holds it is as large as what pulls at it, and no more than static friction. The laws of friction have only sliding: by
them it creeps, and the creep would tell friction with confidence.
"""

from __future__ import annotations

from types import SimpleNamespace

from joint_id_core.data.signals import side_of
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.sentences import listed
from joint_id_core.estimators.shared.stillness import goes_nowhere
from joint_id_core.models.operations import SmoothOps

OTHER = 1.1  # factor of a parameter that is tried
SLOW = 1e-2  # rad/s, at which every part of a law of friction acts


def standing(data: FitData) -> tuple[str, ...]:
    """Return the free parameters that are friction of the link, if it goes nowhere in the recording; else none."""
    if not goes_nowhere(data.recording):
        return ()
    found = {name for velocity in data.model.smoothing if side_of(velocity) == "link" for name in _of(data, velocity)}
    return tuple(name for name in data.free if name in found)


def not_known(names: tuple[str, ...]) -> str:
    """Return what is said of `standing` parameters, as a clause; "" if there are none."""
    if not names:
        return ""
    return f"the link goes nowhere and shows no sliding friction ({listed(names)}): what holds it is static friction"


def _of(data: FitData, velocity: str) -> list[str]:
    """Return the free parameters that do nothing without this velocity."""
    model = data.model
    start = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    u = [signal.scale for signal in model.inputs]

    def rates(speed: float, values: dict[str, float]) -> tuple[float, ...]:
        class Sliding(SmoothOps):
            @staticmethod
            def direction(which: str, w: float, w_s: float) -> float:
                return float(w != 0.0)

        x = [speed if signal.name == velocity else signal.scale for signal in model.states]
        return tuple(model.derivative(x, u, SimpleNamespace(**values), Sliding()))

    def acts(name: str, speed: float) -> bool:
        return rates(speed, start | {name: OTHER * start[name]}) != rates(speed, start)

    return [name for name in data.free if acts(name, SLOW) and not acts(name, 0.0)]
