"""Parameters that enter a model only in combination: what no record can tell apart, found exactly.

A direction v in the space of parameters along which the derivative f of the state does not change, (df/dp) v = 0
for all states and inputs, changes nothing that could ever be measured (Walter & Pronzato, Identification of Parametric
Models, 1997, ch. 2). df/dp is taken by complex steps, exact to rounding, at many random states, so a direction that is
found is one of the model and not of the motion.

These directions form a subspace. A decomposition may return any basis of it, another one on another processor. So the
code works with the projector onto the subspace, which does not depend on the basis. The projector has blocks: one for
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

POINTS = 40  # random states, from a thousandth of their scale up: every part of a friction law shows somewhere
EXACT = (
    1e-9  # singular value, relative to the largest, that stands for zero: rounding is near 1e-15, the rest above 1e-5
)
BELONGS = 1e-6  # share of a direction from which a parameter has a part in it: rounding is near 1e-11
STEP = 1e-30

Kind = Literal["sum", "product", "scale", "other"]


@dataclass(frozen=True)
class Combination:
    """Parameters of which only combinations can be known, whatever is measured.

    `kind` is "sum" (only the sum of weights times values can be known), "product" (only the product of values to the
    power of weights), "scale" (all but a factor common to all of them) or "other" (none of these). `names` are in the
    order of the model's table. `weights` of a sum or a product begin with 1; the other kinds have none.
    """

    names: tuple[str, ...]
    kind: Kind
    weights: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """The combination as a formula, or the names where there is none that is short."""
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
        """Value and standard deviation of the combination, SI units; None where it has no weights or is not finite."""
        if not self.weights:
            return None
        p, w = np.array([values[n] for n in self.names]), np.array(self.weights)
        index = [free.index(n) for n in self.names]
        if self.kind == "sum":
            known, slope = float(w @ p), w
        else:
            with np.errstate(divide="ignore", invalid="ignore"):  # zero, or a root of what is negative
                powers = p**w
                others = [np.prod(np.delete(powers, k)) for k in range(len(p))]
                known, slope = float(np.prod(powers)), w * p ** (w - 1.0) * np.array(others)
        sd = float(np.sqrt(max(slope @ covariance[np.ix_(index, index)] @ slope, 0.0)))
        return (known, sd) if np.isfinite(known) and np.isfinite(sd) else None


@lru_cache(maxsize=64)
def combinations(model: Model, free: tuple[str, ...], zero: frozenset[str] = frozenset()) -> tuple[Combination, ...]:
    """Groups among the parameters `free` that enter the model only in combination; empty for most models as they stand.

    `zero` names the inputs and the held parameters that are zero: a load torque that is not there sets no scale. The
    groups are in the order of the model's table. A single name is a parameter that does not enter at all.
    """
    late = {name for names in model.label_delays.values() for name in names}  # seen in what sensors show, not in f
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
    """Groups that enter only in combination.

    A change of the values that leaves f as it is, the same change at any values, makes a sum. The same for a change of
    the logarithms makes a product or a scale. Directions are in coordinates in which the columns of J have length one.

    Args:
        names: of the free parameters.
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
    """Whether the only direction of a group of logarithms changes all of them alike."""
    direction = lengths[group] / np.linalg.norm(lengths[group])
    return bool(np.allclose(projector[np.ix_(group, group)], np.outer(direction, direction), rtol=0.0, atol=BELONGS))


def _weights(projector: Array, group: NDArray[np.intp], lengths: Array) -> tuple[float, ...]:
    """Weights of the one combination that is the same along all directions of a group; none where there are several."""
    known = np.eye(len(group)) - projector[np.ix_(group, group)]
    if round(float(np.trace(known))) != 1:
        return ()
    normal = known[np.argmax(np.diag(known))] * lengths[group]  # of rank one: every row is a multiple of the normal
    return tuple(float(f"{w:.9g}") for w in (normal / normal[0]).tolist())


def _blocks(projector: Array) -> list[NDArray[np.intp]]:
    """Indices of the coordinates that have to do with each other in a subspace: a projector is zero between blocks."""
    part = np.sqrt(np.maximum(np.diag(projector), 0.0))  # length of each axis' projection
    linked = np.abs(projector) > BELONGS * np.maximum(part[:, None], part)
    count, block = connected_components(linked, directed=False)
    groups = [np.flatnonzero((block == k) & (part > BELONGS)) for k in range(count)]
    return [group for group in groups if len(group)]


def _unseen(J: Array) -> Array:
    """Projector onto the directions that J does not see, shape (free, free)."""
    _, s, vt = np.linalg.svd(J, full_matrices=True)
    rows = vt[int(np.sum(s > EXACT * s[0])) :]
    return np.asarray(rows.T @ rows)


def _span(columns: Array) -> Array:
    """Projector onto what some columns, of length one or shorter, span."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > BELONGS]
    return np.asarray(basis @ basis.T)


def _typical(nominal: float, spread: float, positive: bool) -> float:
    """A value to look from, not zero; a parameter without a nominal value is 1."""
    if np.isfinite(nominal) and nominal != 0.0:
        return nominal
    return 1.0 if positive or not np.isfinite(nominal) else 0.1 * spread


def _sensitivity(
    model: Model, free: tuple[str, ...], zero: frozenset[str], rng: np.random.Generator, redraw: bool
) -> tuple[Array, Array]:
    """Values of the free parameters and df/dp at random states and inputs, both of shape (n * POINTS, free).

    All parameters keep one set of random values, or with `redraw` get another at every state. Each state equation is
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
        if "motor_position" in names and "link_position" in names:
            twist = 1e-3 * rng.standard_normal()
            x[names.index("motor_position")] = p["N"] * (x[names.index("link_position")] + twist)
        u = [0.0 if s.name in zero else size[len(names) + i] * s.scale for i, s in enumerate(model.inputs)]
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
