"""A model's derivative, exact Jacobians and sensor delays as SymPy expressions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Literal

import sympy as sp

from joint_id_core.models import Model

Smoothing = Literal["tanh", "sign"]


class _SymPyOps:
    """`models.Ops` for SymPy. With "sign" the direction is a symbol whose derivative is zero, as in autograd."""

    sin = staticmethod(sp.sin)
    cos = staticmethod(sp.cos)
    exp = staticmethod(sp.exp)
    asinh = staticmethod(sp.asinh)

    def __init__(self, friction: Smoothing) -> None:
        self.friction = friction
        self.signs: dict[sp.Symbol, sp.Expr] = {}
        self.smoothed: dict[sp.Symbol, tuple[sp.Expr, sp.Expr]] = {}

    def direction(self, velocity: str, w: sp.Expr, w_s: sp.Expr) -> sp.Expr:
        if self.friction == "tanh":
            return sp.tanh(w / w_s)
        symbol = sp.Symbol(f"sign_{velocity}")
        self.signs[symbol] = w
        self.smoothed[symbol] = (w, w_s)
        return symbol


@dataclass(frozen=True)
class Derivative:
    """f(x, u, p) with its Jacobians. Symbols are x_i, u_i and p_<name>; `signs` maps sign symbols to velocities.

    h are the sensor readings of the states, with the delays of the model, and C = dh/dx and D = dh/dp their Jacobians.
    All three are None if no sensor has a delay.
    """

    x: tuple[sp.Symbol, ...]
    u: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    f: sp.Matrix
    A: sp.Matrix
    B: sp.Matrix
    G: sp.Matrix
    signs: dict[sp.Symbol, sp.Expr]
    h: sp.Matrix | None = None
    C: sp.Matrix | None = None
    D: sp.Matrix | None = None


def derive(model: Model, friction: Smoothing, sensitive: tuple[str, ...]) -> Derivative:
    """Evaluate the model's derivative with SymPy symbols; A = df/dx, B = df/dp for `sensitive`, G = df/du."""
    x = tuple(sp.symbols(f"x_:{len(model.states)}", real=True))
    u = tuple(sp.symbols(f"u_:{len(model.inputs)}", real=True))
    p = tuple(sp.Symbol(f"p_{name}", real=True) for name in model.parameter_names)
    ops = _SymPyOps(friction)
    named = SimpleNamespace(**dict(zip(model.parameter_names, p, strict=True)))
    f = sp.Matrix(model.derivative(x, u, named, ops))
    wanted = [p[model.parameter_names.index(name)] for name in sensitive]
    known = Derivative(x, u, p, f, f.jacobian(x), f.jacobian(wanted), f.jacobian(u), ops.signs)
    if not model.label_delays:
        return known
    # Taylor series of x(t - s); the third-order term assumes linear motion. The direction of friction is held constant
    # over the delay: its slope at standstill is far too steep for a series.
    held = _SymPyOps("sign")
    f = sp.Matrix(model.derivative(x, u, named, held))
    A = f.jacobian(x)
    rate = A * f
    change = A * rate
    shown = []
    for i, name in enumerate(model.state_names):
        s = sum((getattr(named, delay) for delay in model.label_delays.get(name, ())), sp.Integer(0))
        shown.append(x[i] - s * f[i] + s**2 / 2 * rate[i] - s**3 / 6 * change[i])
    h = sp.Matrix(shown)
    smooth = {symbol: sp.tanh(w / w_s) for symbol, (w, w_s) in held.smoothed.items()}
    h, C, D = (matrix.subs(smooth) for matrix in (h, h.jacobian(x), h.jacobian(wanted)))
    return replace(known, h=h, C=C, D=D)
