"""User settings of a model's parameters for a fit: values, fixed and freed parameters, priors."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from types import SimpleNamespace
from typing import TYPE_CHECKING

from joint_id_core.arguments import require_type
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:  # the command line reads settings without loading NumPy
    from joint_id_core.data.recording import Array
    from joint_id_core.models import Model
    from joint_id_core.results.estimate import Estimate

NOTHING = 1e-9
FARTHEST = 1e12  # times the value in the model's table, beyond which a start hides all else of the motion in rounding
PRIORS = (1e-30, 1e30)  # the least and the largest standard deviation of a prior, whose squares are numbers, too


@dataclass(frozen=True)
class ParameterSettings:
    """Settings of a model's parameters, by name. Parameters that are not named keep the settings of the model's table.

    Attributes:
        values: start values of estimated parameters and values of fixed ones, SI units.
        fixed: parameters to hold although the table estimates them.
        freed: parameters to estimate although the table holds them.
        priors: prior standard deviations that replace the spreads of the table: relative for a positive parameter, else
            in its unit. The mean of the prior is the start value.
        deviations: standard deviations of values that are held, as known from elsewhere, in their units. They are told
            with the estimate, and are in no standard deviation of the others.

    Raises:
        JointIdError: a standard deviation that is not within `PRIORS`, a text in place of a list of names or of a
            number.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    fixed: Collection[str] = ()
    freed: Collection[str] = ()
    priors: Mapping[str, float] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("fixed", "freed"):
            names = getattr(self, name)
            if isinstance(names, str):
                raise JointIdError(f"{name} = {names!r}: give a list of names, e.g. {name}=[{names!r}]")
            require_type(name, names, Iterable, f'give a list of names, such as {name}=["J"]')
            object.__setattr__(self, name, tuple(dict.fromkeys(names)))
        for name in ("values", "priors", "deviations"):
            numbers = getattr(self, name)
            require_type(name, numbers, Mapping, f'give a dictionary, such as {name}={{"J": 2.0}}')
            numbers = dict(numbers)
            for parameter, number in numbers.items():
                require_type(f"{name}: {parameter}", number, Real, "give a number")
            object.__setattr__(self, name, numbers)
        for name, deviation in self.priors.items():
            if not PRIORS[0] <= deviation <= PRIORS[1]:
                raise JointIdError(
                    f"prior {name} = {deviation:g}: a standard deviation is finite and above zero: give one from "
                    f"{PRIORS[0]:g} to {PRIORS[1]:g}"
                )

    @classmethod
    def of_estimate(cls, estimate: Estimate) -> ParameterSettings:
        """Return settings with the values of an estimate and with its fixed and free parameters.

        A regression may find that there is no inertia. A model divides by it, so it gets `NOTHING` of its start value.
        """
        held = [name for name in estimate.values if name not in estimate.free]
        values = {
            p.name: p.value or (NOTHING * p.initial if p.name in estimate.free else 0.0) for p in estimate.parameters
        }
        return cls(values, held, estimate.free)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters with a setting."""
        return tuple(dict.fromkeys((*self.values, *self.fixed, *self.freed, *self.priors)))

    def with_values(self, changes: Mapping[str, float]) -> ParameterSettings:
        """Return a copy with `changes` merged into `values`."""
        return replace(self, values={**self.values, **changes})

    def over(self, other: ParameterSettings) -> ParameterSettings:
        """Return these settings with those of `other` for parameters that have none here."""
        own = set(self.names)
        return ParameterSettings(
            {**other.values, **self.values},
            [*self.fixed, *(n for n in other.fixed if n not in own)],
            [*self.freed, *(n for n in other.freed if n not in own)],
            {**other.priors, **self.priors},
            {**{n: d for n, d in other.deviations.items() if n not in self.values}, **self.deviations},
        )

    def of(self, model: Model) -> ParameterSettings:
        """Return the settings of those parameters that `model` has."""
        return self.only(model.parameter_names)

    def only(self, names: Collection[str]) -> ParameterSettings:
        """Return the settings of the parameters with these names."""
        own = set(names)
        return ParameterSettings(
            {n: v for n, v in self.values.items() if n in own},
            [n for n in self.fixed if n in own],
            [n for n in self.freed if n in own],
            {n: v for n, v in self.priors.items() if n in own},
            {n: v for n, v in self.deviations.items() if n in own},
        )

    def freed_in(self, model: Model) -> tuple[str, ...]:
        """Return the names of the parameters to estimate that the model's table holds.

        Raises:
            JointIdError: as `applied_to`.
        """
        return tuple(name for name in self.applied_to(model)[1] if model.parameter(name).fixed)

    def applied_to(self, model: Model) -> tuple[Array, tuple[str, ...]]:
        """Return start values of all parameters in the model's order, shape (P,), and the names of those to estimate.

        Raises:
            JointIdError: unknown name, value out of bounds, nothing left to estimate, a prior of a fixed parameter, a
                positive parameter to estimate that starts at zero, one beyond all that joints have; a mistake in one's
                own model.
        """
        import numpy as np

        for name in (*self.fixed, *self.freed, *self.priors):
            model.parameter(name)
        _ = model.smoothing  # a call of the derivative, which says what is wrong with it
        start = model.values(self.values)
        free = tuple(
            q.name for q in model.parameters if (not q.fixed or q.name in self.freed) and q.name not in self.fixed
        )
        if not free:
            raise JointIdError(f"model {model.name}: every parameter is fixed, there is nothing to estimate")
        for name in self.priors:
            if name not in free:
                raise JointIdError(f"prior {name}: this parameter is held: free it (--free {name}) or drop its prior")
        for name in (q.name for q in model.parameters if start[q.name] == 0.0):
            if _divides(model, start, name):
                raise JointIdError(
                    f"parameter {name} = 0: model {model.name} divides by it: give a value that is not 0"
                )
        for row in model.parameters:
            if row.positive and start[row.name] > FARTHEST * row.nominal > 0.0:
                raise JointIdError(
                    f"parameter {row.name} = {start[row.name]:g} {row.unit}: no joint comes near it, and a fit finds "
                    f"no way from there: give a value nearer to the usual {row.nominal:g}"
                )
            if row.name in free and row.positive and start[row.name] <= 0.0:
                raise JointIdError(
                    f"parameter {row.name} starts at {start[row.name]:g}: a positive parameter needs a start above "
                    f"zero; give one with --set, or hold it with --fix {row.name}=0"
                )
        return np.array([start[n] for n in model.parameter_names]), free


def _divides(model: Model, values: Mapping[str, float], name: str) -> bool:
    """Return whether a model divides by a parameter that is zero."""
    import numpy as np

    from joint_id_core.models.operations import ArrayOps

    others = {n: v if n == name or (np.isfinite(v) and v != 0.0) else 1.0 for n, v in values.items()}
    x, u = ([np.ones(1) for _ in names] for names in (model.state_names, model.input_names))
    with np.errstate(all="ignore"):
        try:
            rates = model.derivative(x, u, SimpleNamespace(**others), ArrayOps())
        except ZeroDivisionError:
            return True
    return not all(np.isfinite(rate).all() for rate in rates)
