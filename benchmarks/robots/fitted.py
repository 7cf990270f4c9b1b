"""What the benchmark keeps of a fit, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass, field

FRICTION = ("c", "tau_f")
OF_THE_DATA = ("converged", "disagree")  # statuses of fits whose values may be used


@dataclass(frozen=True)
class Value:
    """A parameter: value, standard deviation, verdict."""

    value: float
    sigma: float
    verdict: str = "estimated"


@dataclass(frozen=True)
class Fitted:
    """A fit.

    Attributes:
        case, joint, recording, method: what was fitted by what.
        status, message: as in `Estimate`.
        cpu_s: processor time.
        values: J, c and tau_f.
        held_out: R2 of the drive in motion, of each other recording of the same joint; only of usable fits.
    """

    case: str
    joint: str
    recording: str
    method: str
    status: str
    message: str
    cpu_s: float
    values: dict[str, Value] = field(default_factory=dict)
    held_out: tuple[float, ...] = ()

    def knows(self, name: str) -> bool:
        """Whether this value may be used."""
        return self.status in OF_THE_DATA and name in self.values and self.values[name].verdict == "estimated"

    @property
    def usable(self) -> bool:
        """Whether friction is known."""
        return all(self.knows(name) for name in FRICTION)

    @property
    def good(self) -> bool:
        """Whether the fit says that all is well."""
        return self.status == "converged"


def of_json(row: dict[str, object]) -> Fitted:
    """A fit from `dataclasses.asdict`."""
    values, held_out = row["values"], row["held_out"]
    assert isinstance(values, dict) and isinstance(held_out, list | tuple)
    fields = {**row, "values": {n: Value(**v) for n, v in values.items()}, "held_out": tuple(held_out)}
    return Fitted(**fields)  # type: ignore[arg-type]  # the names are those of the fields
