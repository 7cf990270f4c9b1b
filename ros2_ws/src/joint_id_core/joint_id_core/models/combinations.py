"""Parameters that enter a model only in combination: what no record can tell apart, found exactly.

A direction v in the space of parameters along which the derivative f of the state does not change, (df/dp) v = 0
for all states and inputs, changes nothing that could ever be measured (Walter & Pronzato, Identification of Parametric
Models, 1997, ch. 2). df/dp is taken by complex steps, exact to rounding, at many random states, so a direction that is
found is one of the model and not of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Literal

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.models.operations import ComplexOps

POINTS = 40  # random states, from a thousandth of their scale up: every part of a friction law shows somewhere
EXACT = 1e-9  # singular value, relative to the largest, that stands for zero: rounding is near 1e-14
STEP = 1e-30


@dataclass(frozen=True)
class Combination:
    """Parameters of which only one combination can be known, whatever is measured.

    `kind` is "sum" (weights times values), "product" (values to the power of weights) or "other" (neither: the
    combination depends on further parameters). `names` and `weights` are in the order of the model's table.
    """

    names: tuple[str, ...]
    weights: tuple[float, ...]
    kind: Literal["sum", "product", "other"]

    @property
    def text(self) -> str:
        """The combination as a formula, or the names where there is none that is short."""
        if self.kind == "other" or len(self.names) > 2:
            return f"a scale common to {', '.join(self.names)}" if self.kind == "product" else ", ".join(self.names)
        (a, b), (u, v) = self.names, self.weights
        if self.kind == "product":
            return f"{a} {'*' if v / u > 0 else '/'} {b}" + (f"^{abs(v / u):g}" if abs(abs(v / u) - 1.0) > 1e-6 else "")
        factor = "" if abs(abs(v / u) - 1.0) < 1e-6 else f"{abs(v / u):.6g} "
        return f"{a} {'+' if v / u > 0 else '-'} {factor}{b}"

    def value(self, values: dict[str, float], free: tuple[str, ...], covariance: Array) -> tuple[float, float] | None:
        """Value and standard deviation of a pair's combination, SI units; None where it is no formula of two."""
        if self.kind == "other" or len(self.names) != 2:
            return None
        p = np.array([values[n] for n in self.names])
        w = np.array(self.weights) / self.weights[0]
        index = [free.index(n) for n in self.names]
        known = float(w @ p) if self.kind == "sum" else float(np.prod(p**w))
        slope = w if self.kind == "sum" else known * w / p
        return known, float(np.sqrt(max(slope @ covariance[np.ix_(index, index)] @ slope, 0.0)))


@lru_cache(maxsize=64)
def combinations(model: Model, free: tuple[str, ...], zero: frozenset[str] = frozenset()) -> tuple[Combination, ...]:
    """Groups among the parameters `free` that enter the model only in combination; empty for most models as they stand.

    `zero` names the inputs and the held parameters that are zero: a load torque that is not there sets no scale.
    """
    late = {name for names in model.label_delays.values() for name in names}  # seen in what sensors show, not in f
    free = tuple(name for name in free if name not in late)
    rng = np.random.default_rng(0)
    tables = []
    for _ in range(2):
        p = {
            q.name: 0.0 if q.name in zero else _typical(q.nominal, q.spread, q.positive) * rng.uniform(0.7, 1.4)
            for q in model.parameters
        }
        scale = np.array([p[n] for n in free])
        tables.append((scale, _null_space(_sensitivity(model, p, free, zero, rng) * scale)))
    (scale, first), (other_scale, second) = tables
    found = []
    for v, w in zip(first, second, strict=False):
        support = np.flatnonzero(np.abs(v) > 1e-6 * np.abs(v).max())
        names = tuple(free[i] for i in support)
        logs, plain = v[support], (v * scale)[support]
        other_logs, other_plain = w[support], (w * other_scale)[support]
        if len(support) < 2:  # does not enter at all
            found.append(Combination(names, (0.0,), "other"))
        elif _parallel(logs, other_logs):
            found.append(Combination(names, _across(logs), "product"))
        elif _parallel(plain, other_plain):
            found.append(Combination(names, _across(plain), "sum"))
        else:
            found.append(Combination(names, tuple(np.zeros(len(names)).tolist()), "other"))
    return tuple(found)


def _typical(nominal: float, spread: float, positive: bool) -> float:
    """A value to look from, not zero; a parameter without a nominal value is 1."""
    if np.isfinite(nominal) and nominal != 0.0:
        return nominal
    return 1.0 if positive or not np.isfinite(nominal) else 0.1 * spread


def _sensitivity(
    model: Model, p: dict[str, float], free: tuple[str, ...], zero: frozenset[str], rng: np.random.Generator
) -> Array:
    """df/dp at random states and inputs, shape (POINTS * n, free), each state equation scaled to its own size."""
    blocks = []
    names = model.state_names
    for _ in range(POINTS):
        size = 10.0 ** rng.uniform(-3.0, 0.0, len(names) + len(model.inputs)) * rng.choice([-1.0, 1.0])
        x = [size[i] * s.scale for i, s in enumerate(model.states)]
        if "motor_position" in names and "link_position" in names:
            twist = 1e-3 * rng.standard_normal()
            x[names.index("motor_position")] = p["N"] * (x[names.index("link_position")] + twist)
        u = [0.0 if s.name in zero else size[len(names) + i] * s.scale for i, s in enumerate(model.inputs)]
        columns = []
        for name in free:
            values = SimpleNamespace(**{n: complex(v, STEP if n == name else 0.0) for n, v in p.items()})
            f = model.derivative([complex(v) for v in x], [complex(v) for v in u], values, ComplexOps())
            columns.append([complex(v).imag / STEP for v in f])
        blocks.append(np.array(columns).T)
    return np.concatenate(blocks)


def _null_space(J: Array) -> Array:
    """Directions that J does not see, one a row, each with as few entries as elimination leaves."""
    norm = np.linalg.norm(J, axis=0)
    scaled = J / np.where(norm > 0.0, norm, 1.0)
    _, s, vt = np.linalg.svd(scaled, full_matrices=True)
    rank = int(np.sum(s > EXACT * max(s[0], 1e-300)))
    rows = vt[rank:] / np.where(norm > 0.0, norm, 1.0)
    for k in range(len(rows)):
        rows[k] /= np.abs(rows[k]).max()
        pivot = int(np.argmax(np.abs(rows[k])))
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot] / rows[k, pivot] * rows[k]
    return rows


def _parallel(a: Array, b: Array) -> bool:
    """Whether two directions are the same, entry by entry: their sizes may differ by many orders."""
    return len(a) == len(b) and bool(np.allclose(a / b, a[0] / b[0], rtol=1e-6, atol=0.0))


def _across(v: Array) -> tuple[float, ...]:
    """Weights of the combination that stays the same along v: for two parameters the normal of v, else v itself."""
    return (float(v[1]), -float(v[0])) if len(v) == 2 else tuple(v.tolist())
