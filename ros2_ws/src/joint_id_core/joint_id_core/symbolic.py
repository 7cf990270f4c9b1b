"""A model's derivative and exact Jacobians as SymPy expressions, and as the text of one RK4 step."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Literal

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from joint_id_core.models import Model

Smoothing = Literal["tanh", "sign"]


class _SymPyOps:
    """`models.Ops` on SymPy. With "sign" the direction is a symbol whose derivative is zero, as autograd has it."""

    sin = staticmethod(sp.sin)
    cos = staticmethod(sp.cos)
    exp = staticmethod(sp.exp)
    asinh = staticmethod(sp.asinh)

    def __init__(self, friction: Smoothing) -> None:
        self.friction = friction
        self.signs: dict[sp.Symbol, sp.Expr] = {}

    def direction(self, velocity: str, w: sp.Expr, w_s: sp.Expr) -> sp.Expr:
        if self.friction == "tanh":
            return sp.tanh(w / w_s)
        symbol = sp.Symbol(f"sign_{velocity}")
        self.signs[symbol] = w
        return symbol


@dataclass(frozen=True)
class Derivative:
    """f(x, u, p) with its Jacobians. Symbols are x_i, u_i and p_<name>; `signs` maps sign symbols to velocities."""

    x: tuple[sp.Symbol, ...]
    u: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    f: sp.Matrix
    A: sp.Matrix
    B: sp.Matrix
    G: sp.Matrix
    signs: dict[sp.Symbol, sp.Expr]


def derive(model: Model, friction: Smoothing, sensitive: tuple[str, ...]) -> Derivative:
    """Trace the model's derivative with SymPy; A = df/dx, B = df/dp for `sensitive`, G = df/du."""
    x = tuple(sp.symbols(f"x_:{len(model.states)}", real=True))
    u = tuple(sp.symbols(f"u_:{len(model.inputs)}", real=True))
    p = tuple(sp.Symbol(f"p_{name}", real=True) for name in model.parameter_names)
    ops = _SymPyOps(friction)
    named = SimpleNamespace(**dict(zip(model.parameter_names, p, strict=True)))
    f = sp.Matrix(model.derivative(x, u, named, ops))
    wanted = [p[model.parameter_names.index(name)] for name in sensitive]
    return Derivative(x, u, p, f, f.jacobian(x), f.jacobian(wanted), f.jacobian(u), ops.signs)


class _Hoist:
    """Moves whatever depends on parameters alone out of the time loop, into constants c_k."""

    def __init__(self, p: tuple[sp.Symbol, ...]) -> None:
        self.p = set(p)
        self.constants: dict[sp.Expr, sp.Symbol] = {}

    def _constant(self, expr: sp.Expr) -> sp.Expr:
        if expr.is_Number:
            return expr
        return self.constants.setdefault(expr, sp.Symbol(f"c_{len(self.constants)}"))

    def __call__(self, expr: Any) -> Any:
        if expr.free_symbols <= self.p:
            return self._constant(expr)
        if isinstance(expr, (sp.Add, sp.Mul)):
            known = [a for a in expr.args if a.free_symbols <= self.p]
            rest = [self(a) for a in expr.args if not a.free_symbols <= self.p]
            return expr.func(self._constant(expr.func(*known)), *rest) if known else expr.func(*rest)
        return expr.func(*[self(a) for a in expr.args]) if expr.args else expr


class _Printer(PythonCodePrinter):
    """Python text in which small powers are products, as a compiler wants them."""

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.as_base_exp()
        if exponent.is_Integer and 2 <= abs(int(exponent)) <= 4:
            product = "*".join([f"({self._print(base)})"] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"(1.0/({product}))"
        if exponent == -1:
            return f"(1.0/({self._print(base)}))"
        return super()._print_Pow(expr, rational=rational)


_HEAD = '''\
def step(x, W, D, Q, columns, n_params, u0, u1, c, h, substeps):
    """Advance x and the columns of W by one sample of length h in `substeps` Runge-Kutta 4 steps.

    W holds, in columns, derivatives of x: by the state at the start (NX), by the inputs (NU), by the
    parameters (NP). Of these the first `columns` are advanced; D and Q are work space.
    """
'''


def step_text(model: Model, d: Derivative) -> str:
    """Source of `constants(p, c)` and `step(...)` for one model, with loops over sensitivity columns only.

    Sparse products A W are written out entry by entry, so zeros and ones of A cost nothing.
    """
    nx, nu, n_par = len(d.x), len(d.u), d.B.shape[1]
    hoist = _Hoist(d.p)
    exprs = [hoist(e) for m in (d.f, d.A, d.B, d.G) for e in m]
    temps, exprs = sp.cse(exprs, symbols=sp.numbered_symbols("t_"))
    show = _Printer({"fully_qualified_modules": True}).doprint
    it = iter(exprs)
    f, A, B, G = ([[next(it) for _ in range(m.shape[1])] for _ in range(nx)] for m in (d.f, d.A, d.B, d.G))

    lines = ["def constants(p, c):", '    """Fill c with what depends on the parameters alone."""']
    lines += [f"    {s} = p[{i}]" for i, s in enumerate(d.p)]
    lines += [f"    c[{k}] = {show(e)}" for k, e in enumerate(hoist.constants)] or ["    pass"]
    lines += ["", "", _HEAD.rstrip("\n")]
    out = lines.append
    for k in range(len(hoist.constants)):
        out(f"    c_{k} = c[{k}]")
    for i in range(nx):
        out(f"    b_{i} = x[{i}]")
    out("    hs = h / substeps")
    out("    for s in range(substeps):")
    for stage, (at, weight) in enumerate([("0.0", None), ("0.5", "1.0"), ("0.5", "2.0"), ("1.0", "2.0")]):
        for i, signal in enumerate(model.inputs):
            if signal.hold == "first":
                out(f"        u_{i} = u0[{i}] + (s + {at}) / substeps * (u1[{i}] - u0[{i}])")
            elif stage == 0:
                out(f"        u_{i} = u0[{i}]")
        for i in range(nx):
            out(f"        x_{i} = b_{i}" + (f" + {at} * hs * k_{i}" if stage else ""))
        for symbol, w in d.signs.items():
            out(f"        {symbol} = 1.0 * ({show(w)} > 0.0) - 1.0 * ({show(w)} < 0.0)")
        for t, e in temps:
            out(f"        {t} = {show(e)}")
        for i in range(nx):
            out(f"        k_{i} = {show(f[i][0])}")
            out(f"        r_{i} = " + (f"r_{i} + {2.0 if stage in (1, 2) else 1.0} * k_{i}" if stage else f"k_{i}"))
        terms: list[str] = []
        for i in range(nx):
            products = []
            for k in range(nx):
                if A[i][k] == 1:
                    products.append(f"y_{k}")
                elif A[i][k] != 0:
                    out(f"        a_{i}_{k} = {show(A[i][k])}")
                    products.append(f"a_{i}_{k} * y_{k}")
            terms.append(" + ".join(products) or "0.0")
        out("        for j in range(columns):")
        for i in range(nx):
            if stage:
                out(f"            d_{i} = D[{i}, j]")
                out(f"            Q[{i}, j] = " + (f"d_{i}" if stage == 1 else f"Q[{i}, j] + {weight} * d_{i}"))
            out(f"            y_{i} = W[{i}, j]" + (f" + {at} * hs * d_{i}" if stage else ""))
        for i in range(nx):
            out(f"            D[{i}, j] = {terms[i]}")
        out("        if columns > NX:")
        for i in range(nx):
            for k in range(nu):
                if G[i][k] != 0:
                    out(f"            D[{i}, {nx + k}] += {show(G[i][k])}")
        out("            pass")
        out("        if n_params > 0:")
        for i in range(nx):
            for k in range(n_par):
                if B[i][k] != 0:
                    out(f"            D[{i}, {nx + nu + k}] += {show(B[i][k])}")
        out("            pass")
    for i in range(nx):
        out(f"        b_{i} = b_{i} + hs / 6.0 * r_{i}")
    out("        for j in range(columns):")
    for i in range(nx):
        out(f"            W[{i}, j] += hs / 6.0 * (Q[{i}, j] + D[{i}, j])")
    for i in range(nx):
        out(f"    x[{i}] = b_{i}")
    header = [f"NX = {nx}", f"NU = {nu}", f"NP = {n_par}", f"NC = {max(1, len(hoist.constants))}", ""]
    return "\n".join([*header, "", *lines]) + "\n"
