"""The equations of motion of a model as linear equations in its parameters.

Every rate of a model has the form f = g / m, with an inertia (or inductance) m. The equation m dx/dt = g is then linear
in m and in most other parameters. Which ones are linear is found by evaluating the model, so that any model will do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.models.operations import ArrayOps

ROUNDING = 1e-9  # relative error of a linear function
DIFFERENCE = 1e-6  # the same of a column, a difference of large torques


@dataclass(frozen=True)
class Equation:
    """Known terms y (T,) = sum of columns (T, k) times the parameters `names`, at every sample; a torque or a voltage.

    Attributes:
        state, inertia: whose rate it gives, and the parameter that multiplies this rate.
        factor: part of y for one unit of the drive (0 if y does not contain the drive).
        static: True for columns of a joint that stands still, such as those of gravity, shape (k,).
    """

    state: str
    inertia: str
    names: tuple[str, ...]
    y: Array
    columns: Array
    factor: float
    static: NDArray[np.bool_]

    @property
    def quantity(self) -> str:
        """What the equation is of."""
        return "voltage" if self.state == "current" else "torque"


@dataclass(frozen=True)
class Motion:
    """What was measured: states x and inputs u by name, and the rates dx/dt of the states, arrays of shape (T,)."""

    x: Mapping[str, Array]
    u: Mapping[str, Array]
    rates: Mapping[str, Array]

    @property
    def stopped(self) -> Motion:
        """The same positions and inputs without any velocity."""
        x = {n: np.zeros_like(v) if n.endswith("_velocity") else v for n, v in self.x.items()}
        return Motion(x, self.u, {n: np.zeros_like(v) for n, v in self.rates.items()})

    @property
    def known(self) -> Motion:
        """The samples at which all of it is known."""
        parts = (self.x, self.u, self.rates)
        rows = np.all([np.isfinite(v) for part in parts for v in part.values()], axis=0)
        return Motion(*({n: v[rows] for n, v in part.items()} for part in parts))


def equations(model: Model, motion: Motion, values: Mapping[str, float], free: Sequence[str]) -> list[Equation]:
    """Return the equations that hold free parameters; `values` are those of all parameters.

    Free parameters in which an equation is not linear keep their values.
    """
    found, known = [], motion.known
    for state in model.state_names:
        inertia = _inertia(model, state, known, values)
        if inertia is None:
            continue
        names = [n for n in free if _matters(model, state, inertia, known, values, n)]
        linear = _linear(model, state, inertia, known, values, names)
        if linear:
            found.append(_equation(model, state, inertia, motion, values, linear))
    return found


def columns_along(model: Model, equation: Equation, motion: Motion, values: Mapping[str, float]) -> Array:
    """Return the columns (T, k) of an equation for another motion."""
    return _columns(model, equation.state, equation.inertia, motion, values, equation.names)[1]


def _error(
    model: Model, state: str, inertia: str, motion: Motion, values: Mapping[str, float], drive: float | None = None
) -> Array:
    """Return m dx/dt - g at all samples, shape (T,); with `drive`, at this constant value of the drive."""
    p = SimpleNamespace(**values)
    inputs = [motion.u[n] if n != model.drive or drive is None else np.full_like(motion.u[n], drive) for n in motion.u]
    rates = model.derivative(list(motion.x.values()), inputs, p, ArrayOps())
    rate = rates[model.state_names.index(state)]
    return np.asarray(values[inertia] * (motion.rates[state] - rate))


def _inertia(model: Model, state: str, motion: Motion, values: Mapping[str, float]) -> str | None:
    """Return the parameter in the denominator of a rate; None if there is none."""
    place = model.state_names.index(state)

    def rate(changed: Mapping[str, float]) -> Array:
        x, u = list(motion.x.values()), list(motion.u.values())
        return np.asarray(model.derivative(x, u, SimpleNamespace(**changed), ArrayOps())[place])

    base = rate(values)
    for name in model.parameter_names:
        half = rate({**values, name: 2.0 * values[name]})
        if values[name] > 0.0 and np.any(base != 0.0) and np.allclose(2.0 * half, base, rtol=ROUNDING, atol=0.0):
            return name
    return None


def _step(values: Mapping[str, float], name: str) -> float:
    return values[name] or 1.0


def _matters(model: Model, state: str, inertia: str, motion: Motion, values: Mapping[str, float], name: str) -> bool:
    moved = {**values, name: values[name] + _step(values, name)}
    return bool(np.any(_error(model, state, inertia, motion, moved) != _error(model, state, inertia, motion, values)))


def _linear(
    model: Model, state: str, inertia: str, motion: Motion, values: Mapping[str, float], names: Sequence[str]
) -> tuple[str, ...]:
    """Return the names in which the equation is linear together; earlier ones have precedence."""
    base = _error(model, state, inertia, motion, values)
    kept: list[str] = []
    change = np.zeros_like(base)
    moved = dict(values)
    for name in names:
        step = _step(values, name)
        alone = _error(model, state, inertia, motion, {**values, name: values[name] + step}) - base
        twice = _error(model, state, inertia, motion, {**values, name: values[name] + 2.0 * step}) - base
        together = _error(model, state, inertia, motion, {**moved, name: values[name] + step}) - base
        size = ROUNDING * (np.abs(base).max() + np.abs(alone).max() + np.abs(change).max())
        if np.abs(twice - 2.0 * alone).max() < size and np.abs(together - change - alone).max() < size:
            kept.append(name)
            moved[name], change = values[name] + step, together
    return tuple(kept)


def _equation(
    model: Model, state: str, inertia: str, motion: Motion, values: Mapping[str, float], names: tuple[str, ...]
) -> Equation:
    base, columns = _columns(model, state, inertia, motion, values, names)
    y = columns @ [values[n] for n in names] - base
    known, factor = motion.known, 0.0
    moving, still = (_columns(model, state, inertia, one, values, names)[1] for one in (known, known.stopped))
    if model.drive is not None:
        zero, one = (_error(model, state, inertia, known, values, drive)[0] for drive in (0.0, 1.0))
        factor = float(zero - one)
    apart, size = np.abs(still - moving).max(axis=0, initial=0.0), np.abs(moving).max(axis=0, initial=0.0)
    return Equation(state, inertia, names, y, columns, factor, apart < DIFFERENCE * size)


def _columns(
    model: Model, state: str, inertia: str, motion: Motion, values: Mapping[str, float], names: tuple[str, ...]
) -> tuple[Array, Array]:
    """Return m dx/dt - g (T,), and its derivatives by the parameters, shape (T, k)."""
    base = _error(model, state, inertia, motion, values)
    columns = np.empty((len(base), len(names)))
    for k, name in enumerate(names):
        step = _step(values, name)
        columns[:, k] = (_error(model, state, inertia, motion, {**values, name: values[name] + step}) - base) / step
    return base, columns
