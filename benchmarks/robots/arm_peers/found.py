"""What a method finds of an arm in one log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from joint_id_core.data.recording import Array
from robots.arm_peers.logs import Log
from robots.fitted import Value

Scores = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Found:
    """A fit of one log.

    Attributes:
        friction: by quantity ("damping", "friction"), a value for each joint; their standard deviation is NaN where
            the method does not call the value known.
        whole, moving: by name of each other log, R2 of the torque of each joint that this fit predicts, of all samples
            and of those in motion.
        rotors: inertia of each rotor in kg m^2, as far as the method tells it apart from the links.
        masses: of the links in kg; empty if the method finds base parameters only.
        cpu_s: processor time of the fit.
        infinite: intervals that the method itself calls infinite.
        note: what else happened.
    """

    friction: Mapping[str, Sequence[Value]]
    whole: Scores
    moving: Scores
    rotors: Sequence[float] = ()
    masses: Sequence[float] = ()
    cpu_s: float = 0.0
    infinite: int = 0
    note: str = ""


@dataclass(frozen=True)
class Method:
    """What a method made of all logs.

    Attributes:
        name: of the method, with its version.
        fits: one for each log.
        failed: why there are none, or not all; empty otherwise.
    """

    name: str
    fits: Sequence[Found] = field(default_factory=tuple)
    failed: str = ""


def scores(predict: Callable[[Log], Array], others: Sequence[Log]) -> tuple[Scores, Scores]:
    """What `Found` calls `whole` and `moving`, from torques (T, n) that a fit predicts for a log."""
    predicted = {log.name: predict(log) for log in others}
    whole = {log.name: log.r_squared(predicted[log.name]) for log in others}
    return whole, {log.name: log.r_squared(predicted[log.name], in_motion=True) for log in others}


def of_json(row: dict[str, object]) -> Method:
    """A method from `dataclasses.asdict`."""
    fits = row["fits"]
    assert isinstance(fits, list | tuple)
    return Method(str(row["name"]), tuple(map(_found, fits)), str(row["failed"]))


def _found(row: dict[str, object]) -> Found:
    friction = row["friction"]
    assert isinstance(friction, dict)
    values = {n: [Value(**v) for v in some] for n, some in friction.items()}
    return Found(**{**row, "friction": values})  # type: ignore[arg-type]  # the names are those of the fields
