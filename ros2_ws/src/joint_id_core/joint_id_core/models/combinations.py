"""Find parameters that enter a model only in combination, so that no record can separate them.

This is a test of structural identifiability (Walter & Pronzato, Identification of Parametric Models, 1997, ch. 2). Let
f be the derivative of the state. A direction v in the space of parameters with (df/dp) v = 0 for all states and inputs
changes nothing that can be measured. df/dp is computed by complex steps, exact to rounding, at many random states. So
the directions that are found are a property of the model and not of the motion.

These directions form a subspace. A decomposition may return any basis of it, another one on another processor. So the
code works with the projector onto the subspace, which does not depend on the basis. The projector has one block for
each group of parameters that enter only in combination.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.models.operations import ComplexOps

POINTS = 40  # random states, from 0.001 of their scale up, so that every part of a friction law has an effect
# Singular values below this, relative to the largest, count as zero: rounding is near 1e-15, the others are above 1e-5.
EXACT = 1e-9
BELONGS = 1e-6  # least component of a parameter that belongs to a direction: rounding is near 1e-11
STEP = 1e-30

Kind = Literal["sum", "product", "scale", "other"]


@dataclass(frozen=True)
class Combination:
    """Parameters of which only combinations can be identified, whatever is measured.

    Attributes:
        names: the parameters, in the order of the model's table.
        kind: "sum": only the sum of weights times values can be identified; "product": only the product of values to
            the power of weights; "scale": everything except a common factor of all values; "other": none of these.
        weights: for a sum or a product, the first one is 1; () for the other kinds.
    """

    names: tuple[str, ...]
    kind: Kind
    weights: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """The combination as a formula; the names if there is no short formula."""
        if not self.weights:
            return ", ".join(self.names)
        text = self.names[0]
        for name, weight in zip(self.names[1:], self.weights[1:], strict=True):
            size = "" if abs(weight) == 1.0 else f"{abs(weight):.6g}"
            if self.kind == "product":
                text += f" {'*' if weight > 0 else '/'} {name}" + (f"^{size}" if size else "")
            else:
                text += f" {'+' if weight > 0 else '-'} " + (f"{size} " if size else "") + name
        return text

    def value(self, values: dict[str, float], free: tuple[str, ...], covariance: Array) -> tuple[float, float] | None:
        """Return value and standard deviation of the combination, SI units; None without weights or if not finite."""
        if not self.weights:
            return None
        p, w = np.array([values[n] for n in self.names]), np.array(self.weights)
        index = [free.index(n) for n in self.names]
        if self.kind == "sum":
            known, slope = float(w @ p), w
        else:
            with np.errstate(divide="ignore", invalid="ignore"):  # division by zero, or root of a negative value
                powers = p**w
                others = [np.prod(np.delete(powers, k)) for k in range(len(p))]
                known, slope = float(np.prod(powers)), w * p ** (w - 1.0) * np.array(others)
        sd = float(np.sqrt(max(slope @ covariance[np.ix_(index, index)] @ slope, 0.0)))
        return (known, sd) if np.isfinite(known) and np.isfinite(sd) else None


@lru_cache(maxsize=64)
def combinations(model: Model, free: tuple[str, ...], zero: frozenset[str] = frozenset()) -> tuple[Combination, ...]:
    """Return the groups of parameters among `free` that enter the model only in combination.

    The result is empty for most models with their default parameters. The groups are in the order of the model's table.
    A group of one name is a parameter without any effect. `zero` names the inputs and the fixed parameters that are
    zero: for example, a load torque of zero does not determine a scale.
    """
    late = {name for names in model.label_delays.values() for name in names}  # they act on the sensors, not on f
    free = tuple(name for name in model.parameter_names if name in free and name not in late)
    if not free:
        return ()
    rng = np.random.default_rng(0)
    scale, J = _sensitivity(model, free, zero, rng, redraw=False)
    others, other_J = _sensitivity(model, free, zero, rng, redraw=True)
    effect = np.linalg.norm(scale * J, axis=0)
    enters = effect > EXACT * np.max(effect)
    found = [Combination((name,), "other") for name, does in zip(free, enters, strict=True) if not does]
    if enters.any():
        names = tuple(name for name, does in zip(free, enters, strict=True) if does)
        found += _groups(names, scale[0, enters], J[:, enters], others[:, enters], other_J[:, enters])
    return tuple(sorted(found, key=lambda group: [free.index(name) for name in group.names]))


def _groups(names: tuple[str, ...], scale: Array, J: Array, others: Array, other_J: Array) -> list[Combination]:
    """Return the groups of parameters that enter only in combination.

    If a change of the values does not change f, and this holds for any values, the group is a sum. If the same holds
    for a change of the logarithms, the group is a product or a scale. Directions are in coordinates in which the
    columns of J have length one.

    Args:
        names: names of the free parameters.
        scale, J: one set of values, shape (free,), and df/dp there at many states, shape (rows, free).
        others, other_J: another set of values in each row, and df/dp there, both of shape (rows, free).
    """
    unit = np.linalg.norm(J, axis=0)
    here = J / unit
    sums = _unseen(np.concatenate([here, other_J / unit]))
    products = _unseen(np.concatenate([here, other_J * others / (scale * unit)]))
    found = []
    for group in _blocks(sums):
        weights = _weights(sums, group, unit)
        found.append(Combination(_picked(names, group), "sum" if weights else "other", weights))
    for group in _blocks(products):
        weights = _weights(products, group, unit * scale)
        kind: Kind = "product" if weights else "scale" if _is_scale(products, group, unit * scale) else "other"
        found.append(Combination(_picked(names, group), kind, weights))
    named = _span(np.concatenate([sums, products], axis=1))
    rest = _span((np.eye(len(names)) - named) @ _unseen(here))
    return found + [Combination(_picked(names, group), "other") for group in _blocks(rest)]


def _picked(names: tuple[str, ...], group: NDArray[np.intp]) -> tuple[str, ...]:
    return tuple(names[i] for i in group)


def _is_scale(projector: Array, group: NDArray[np.intp], lengths: Array) -> bool:
    """Return whether a group has only one direction, and this changes all logarithms by the same amount."""
    direction = lengths[group] / np.linalg.norm(lengths[group])
    return bool(np.allclose(projector[np.ix_(group, group)], np.outer(direction, direction), rtol=0.0, atol=BELONGS))


def _weights(projector: Array, group: NDArray[np.intp], lengths: Array) -> tuple[float, ...]:
    """Return the weights of the only combination that all directions of a group leave constant; () if not only one."""
    known = np.eye(len(group)) - projector[np.ix_(group, group)]
    if round(float(np.trace(known))) != 1:
        return ()
    normal = known[np.argmax(np.diag(known))] * lengths[group]  # of rank one: every row is a multiple of the normal
    return tuple(float(f"{w:.9g}") for w in (normal / normal[0]).tolist())


def _blocks(projector: Array) -> list[NDArray[np.intp]]:
    """Return the blocks of a projector, as arrays of indices: it is zero between coordinates of different blocks."""
    part = np.sqrt(np.maximum(np.diag(projector), 0.0))  # length of each axis' projection
    linked = np.abs(projector) > BELONGS * np.maximum(part[:, None], part)
    count, block = connected_components(linked, directed=False)
    groups = [np.flatnonzero((block == k) & (part > BELONGS)) for k in range(count)]
    return [group for group in groups if len(group)]


def _unseen(J: Array) -> Array:
    """Return the projector onto the null space of J, shape (free, free)."""
    _, s, vt = np.linalg.svd(J, full_matrices=True)
    rows = vt[int(np.sum(s > EXACT * s[0])) :]
    return np.asarray(rows.T @ rows)


def _span(columns: Array) -> Array:
    """Return the projector onto the span of columns whose length is at most one."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > BELONGS]
    return np.asarray(basis @ basis.T)


def _typical(nominal: float, spread: float, positive: bool) -> float:
    """Return a value that is not zero, near which to evaluate the model; 1 without a nominal value."""
    if np.isfinite(nominal) and nominal != 0.0:
        return nominal
    return 1.0 if positive or not np.isfinite(nominal) else 0.1 * spread


def _sensitivity(
    model: Model, free: tuple[str, ...], zero: frozenset[str], rng: np.random.Generator, redraw: bool
) -> tuple[Array, Array]:
    """Return values of the free parameters and df/dp at random states and inputs, both of shape (n * POINTS, free).

    The parameters have one set of random values, or with `redraw` a new set at every state. Each state equation is
    scaled to its own size.
    """
    names, count = model.state_names, len(model.states) + len(model.inputs)
    p: dict[str, float] = {}
    values, points = [], []
    for _ in range(POINTS):
        if redraw or not p:
            p = {
                q.name: 0.0 if q.name in zero else _typical(q.nominal, q.spread, q.positive) * rng.uniform(0.7, 1.4)
                for q in model.parameters
            }
        size = 10.0 ** rng.uniform(-3.0, 0.0, count) * rng.choice([-1.0, 1.0], count)
        x = [size[i] * s.scale for i, s in enumerate(model.states)]
        u = [0.0 if s.name in zero else size[len(names) + i] * s.scale for i, s in enumerate(model.inputs)]
        known = dict(zip((*names, *model.input_names), (*x, *u), strict=True))
        if "motor_position" in names and "link_position" in known:  # a larger twist would hide all else
            twist = 1e-3 * rng.standard_normal()
            x[names.index("motor_position")] = p["N"] * (known["link_position"] + twist)
        columns = []
        for name in free:
            point = SimpleNamespace(**{n: complex(v, STEP if n == name else 0.0) for n, v in p.items()})
            f = model.derivative([complex(v) for v in x], [complex(v) for v in u], point, ComplexOps())
            columns.append([complex(v).imag / STEP for v in f])
        points.append(np.array(columns).T)
        values.append([p[name] for name in free])
    scale, by_state = np.array(values), np.stack(points, axis=1)  # (POINTS, free), (n, POINTS, free)
    effect = np.linalg.norm(by_state * scale, axis=(1, 2), keepdims=True)
    J = np.concatenate(by_state / np.where(effect > 0.0, effect, 1.0))
    return np.tile(scale, (len(by_state), 1)), J
