"""Write the Python source of a model's cell from its derivative and Jacobians; `cell.kernel` compiles it."""

from __future__ import annotations

from typing import Any, Literal

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from joint_id_core.cell.loops.innovations import layout
from joint_id_core.cell.loops.simulate import padded
from joint_id_core.cell.symbolic import Derivative
from joint_id_core.models import Model

Cell = Literal["rk4", "implicit"]


class _Hoist:
    """Moves expressions that depend only on parameters out of the time loop, into constants c_k."""

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
    """Prints Python source in which small powers are products, which compile to faster code."""

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.as_base_exp()
        if exponent.is_Integer and 2 <= abs(int(exponent)) <= 4:
            product = "*".join([f"({self._print(base)})"] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"(1.0/({product}))"
        if exponent == -1:
            return f"(1.0/({self._print(base)}))"
        return super()._print_Pow(expr, rational=rational)


# Columns of the sensitivities W in the work space V: derivatives of the state by the parameters, then (full) by the
# state at the start of the sample and by the inputs. The rows of D (its time derivative) and of Q (the weighted sum of
# these) follow in the same array. The sizes are constants, so that the compiler can prove that nothing overlaps and
# uses vector instructions.


class _Text:
    """Source text for one model: the expressions of f, A, B, G and their common subexpressions."""

    sign = "1.0 * ({0} > 0.0) - 1.0 * ({0} < 0.0)"

    def __init__(self, model: Model, d: Derivative) -> None:
        self.model, self.d = model, d
        self.nx, self.nu, self.n_par = len(d.x), len(d.u), d.B.shape[1]
        hoist = _Hoist(d.p)
        exprs = [hoist(e) for m in (d.f, d.A, d.B, d.G) for e in m]
        state_only = sp.cse(exprs[: self.nx], symbols=sp.numbered_symbols("t_"))
        every = sp.cse(exprs, symbols=sp.numbered_symbols("t_"))
        self.observation: tuple[list[Any], list[Any]] | None = None
        if d.h is not None and d.C is not None and d.D is not None:
            self.observation = sp.cse([hoist(e) for m in (d.h, d.C, d.D) for e in m], sp.numbered_symbols("t_"))
        self.constants = hoist.constants
        self.show = _Printer({"fully_qualified_modules": True}).doprint
        self.state_temps, self.state_f = state_only
        self.temps, flat = every
        it = iter(flat)
        self.f, self.A, self.B, self.G = (
            [[next(it) for _ in range(m.shape[1])] for _ in range(self.nx)] for m in (d.f, d.A, d.B, d.G)
        )

    def constants_function(self) -> list[str]:
        """Return the lines of `constants(p, c)`."""
        lines = ["def constants(p, c):", '    """Fill c with what depends on the parameters alone."""']
        lines += [f"    {s} = p[{i}]" for i, s in enumerate(self.d.p)]
        return lines + ([f"    c[{k}] = {self.show(e)}" for k, e in enumerate(self.constants)] or ["    pass"])

    def _inputs(self, at: str) -> list[str]:
        held = [f"u_{i} = u0[{i}]" for i, s in enumerate(self.model.inputs) if s.hold == "zero" and at == "0.0"]
        ramps = [f"u_{i} = {self._between(i)}" for i, s in enumerate(self.model.inputs) if s.hold == "first"]
        return [*held, f"at = (s + {at}) / substeps", *ramps] if ramps else held

    def _between(self, i: int) -> str:
        """Return the value of an input a share `at` of the sample after its start."""
        rate = self.model.rates[i]
        straight = f"u0[{i}] + at * (u1[{i}] - u0[{i}])"
        return straight if rate is None else f"{straight} - 0.5 * at * (1.0 - at) * h * (u1[{rate}] - u0[{rate}])"

    def _signs(self) -> list[str]:
        show = self.show
        return [f"{s} = {self.sign.format(show(w))}" for s, w in self.d.signs.items()]

    def step(self, name: str, columns: str | None, full: bool) -> list[str]:
        """Return the lines of `name(x, V, u0, u1, c, h, substeps)`, which advances one sample in RK4 steps.

        `columns` is the name of the constant with the number of sensitivity columns in V, None without sensitivities.
        With `full` V also has the derivatives by state and input.
        """
        nx, show = self.nx, self.show
        lines = [f"def {name}(x, V, u0, u1, c, h, substeps):"]
        out = lines.append
        out('    """Advance x and the sensitivities in V by one sample of length h, `substeps` Runge-Kutta 4 steps."""')
        for k in range(len(self.constants)):
            out(f"    c_{k} = c[{k}]")
        for i in range(nx):
            out(f"    b_{i} = x[{i}]")
        out("    hs = h / substeps")
        out("    for s in range(substeps):")
        for stage, (at, weight) in enumerate([("0.0", None), ("0.5", "1.0"), ("0.5", "2.0"), ("1.0", "2.0")]):
            lines += [f"        {line}" for line in self._inputs(at)]
            for i in range(nx):
                out(f"        x_{i} = b_{i}" + (f" + {at} * hs * k_{i}" if stage else ""))
            lines += [f"        {line}" for line in self._signs()]
            temps, f = (self.temps, [row[0] for row in self.f]) if columns else (self.state_temps, self.state_f)
            lines += [f"        {t} = {show(e)}" for t, e in temps]
            for i in range(nx):
                out(f"        k_{i} = {show(f[i])}")
                out(f"        r_{i} = " + (f"r_{i} + {2.0 if stage in (1, 2) else 1.0} * k_{i}" if stage else f"k_{i}"))
            if columns:
                lines += self._sensitivities(columns, full, stage, at, weight)
        for i in range(nx):
            out(f"        b_{i} = b_{i} + hs / 6.0 * r_{i}")
        if columns:
            out(f"        for j in range({columns}):")
            for i in range(nx):
                w, d, q = self._places(columns, i)
                out(f"            V[{w}] += hs / 6.0 * (V[{q}] + V[{d}])")
        for i in range(nx):
            out(f"    x[{i}] = b_{i}")
        return lines

    def _places(self, columns: str, i: int) -> tuple[str, str, str]:
        w, d, q = (f"{i + k * self.nx} * {columns} + j" for k in range(3))
        return w, d, q

    def _sensitivities(self, columns: str, full: bool, stage: int, at: str, weight: str | None) -> list[str]:
        """Return the lines of D = A (W + at hs D) + B for all columns, with Q the weighted sum of earlier stages.

        The sparse product is written entry by entry, so zeros and ones of A take no time.
        """
        nx, show, lines = self.nx, self.show, list[str]()
        out = lines.append
        terms = []
        for i in range(nx):
            products = []
            for k in range(nx):
                if self.A[i][k] == 1:
                    products.append(f"y_{k}")
                elif self.A[i][k] != 0:
                    out(f"        a_{i}_{k} = {show(self.A[i][k])}")
                    products.append(f"a_{i}_{k} * y_{k}")
            terms.append(" + ".join(products) or "0.0")
        out(f"        for j in range({columns}):")
        for i in range(nx):
            w, d, q = self._places(columns, i)
            if stage:
                out(f"            d_{i} = V[{d}]")
                out(f"            V[{q}] = " + (f"d_{i}" if stage == 1 else f"V[{q}] + {weight} * d_{i}"))
            out(f"            y_{i} = V[{w}]" + (f" + {at} * hs * d_{i}" if stage else ""))
        for i in range(nx):
            out(f"            V[{self._places(columns, i)[1]}] = {terms[i]}")
        blocks = [(self.B, 0), (self.G, self.n_par + nx)] if full else [(self.B, 0)]
        for matrix, first in blocks:
            for i in range(nx):
                for k, e in enumerate(matrix[i]):
                    if e != 0:
                        out(f"        V[{nx + i} * {columns} + {first + k}] += {show(e)}")
        return lines

    def _at(self, temps: list[Any], inputs: list[str] | None = None) -> list[str]:
        """Return the lines that unpack c, x and u and compute the common subexpressions."""
        lines = [f"    c_{k} = c[{k}]" for k in range(len(self.constants))]
        lines += [f"    x_{i} = x[{i}]" for i in range(self.nx)]
        lines += [f"    u_{i} = {source}[{i}]" for i, source in enumerate(inputs or ["u"] * self.nu)]
        return [*lines, *(f"    {s}" for s in self._signs()), *(f"    {t} = {self.show(e)}" for t, e in temps)]

    def jacobian(self) -> list[str]:
        """Return the lines of `jacobian(x, u, c, A)`."""
        lines = ["def jacobian(x, u, c, A):", '    """Fill A with df/dx."""', *self._at(self.temps)]
        return lines + [f"    A[{i}, {k}] = {self.show(e)}" for i, row in enumerate(self.A) for k, e in enumerate(row)]

    def observe(self) -> list[str]:
        """Return the lines of `observe(x, u0, u1, c, y, C, D)`: sensor readings of all states and their derivatives."""
        nx, n = self.nx, self.n_par
        lines = [
            "def observe(x, u0, u1, c, y, C, D):",
            '    """Fill y with what sensors show of x, C = dy/dx and D = dy/dp; u0 was held until now, u1 is now."""',
        ]
        if self.observation is None:
            return [*lines, "    pass"]
        temps, flat = self.observation
        lines += self._at(temps, [f"u{int(s.hold == 'first')}" for s in self.model.inputs])
        lines += [f"    y[{i}] = {self.show(e)}" for i, e in enumerate(flat[:nx])]
        lines += [f"    C[{k // nx}, {k % nx}] = {self.show(e)}" for k, e in enumerate(flat[nx : nx + nx * nx])]
        return lines + [f"    D[{k // n}, {k % n}] = {self.show(e)}" for k, e in enumerate(flat[nx + nx * nx :])]

    def point(self) -> list[str]:
        """Return the lines of `inputs`, `slope` and `linearise`, for a cell whose stages are not written out."""
        lines = [
            "def inputs(u0, u1, at, h, u):",
            '    """Fill u with the inputs a share `at` of the sample, which is h long, after its start."""',
        ]
        for i, signal in enumerate(self.model.inputs):
            lines.append(f"    u[{i}] = {self._between(i) if signal.hold == 'first' else f'u0[{i}]'}")
        lines += ["", "", "def slope(x, u, c, f):", '    """Fill f with the derivative of the state."""']
        lines += self._at(self.state_temps) + [f"    f[{i}] = {self.show(e)}" for i, e in enumerate(self.state_f)]
        lines += ["", "", "def linearise(x, u, c, f, A, B, G):", '    """Fill f, df/dx, df/dp and df/du."""']
        lines += self._at(self.temps) + [f"    f[{i}] = {self.show(row[0])}" for i, row in enumerate(self.f)]
        for name, matrix in (("A", self.A), ("B", self.B), ("G", self.G)):
            lines += [
                f"    {name}[{i}, {k}] = {self.show(e)}" for i, row in enumerate(matrix) for k, e in enumerate(row)
            ]
        return lines


_IMPLICIT_STEPS = [
    "from joint_id_core.cell.loops.esdirk import step, step_columns",
    "",
    "",
    "def step_parameters(x, V, u0, u1, c, h, substeps):",
    "    step_columns(CP, x, V, u0, u1, c, h, substeps)",
    "",
    "",
    "def step_full(x, V, u0, u1, c, h, substeps):",
    "    step_columns(CF, x, V, u0, u1, c, h, substeps)",
]


def point_text(model: Model, d: Derivative) -> str:
    """Return the source of `constants`, `observe`, `inputs`, `slope` and `linearise`: plain lines without loops.

    Their variables may be numbers, or tensors with a value for each element of a batch: see `tensors.torch_cell`. They
    call functions of `math`, and `sign`.
    """
    text = _Text(model, d)
    text.sign = "sign({0})"  # of a tensor, a truth value times 1.0 has single precision
    functions = [text.constants_function(), text.observe(), text.point()]
    return "\n".join(line for f in functions for line in [*f, "", ""]) + "\n"


def cell_text(model: Model, d: Derivative, cell: Cell) -> str:
    """Return the source of the functions of one model that the loops call."""
    text = _Text(model, d)
    sizes = {
        "NX": text.nx,
        "NU": text.nu,
        "NP": text.n_par,
        "NC": max(1, len(text.constants)),
        "NW": (3 if cell == "rk4" else 8) * text.nx,
        "CP": padded(text.n_par),
        "CF": padded(text.n_par + text.nx + text.nu),
    }
    sizes["SP"] = sizes["NW"] * sizes["CP"]
    sizes |= layout(text.nx, text.n_par, sizes["CP"], sizes["NW"] * sizes["CF"])
    functions = [text.constants_function(), text.jacobian(), text.observe()]
    if cell == "rk4":
        functions += [
            text.step("step", None, False),
            text.step("step_parameters", "CP", False),
            text.step("step_full", "CF", True),
        ]
    else:
        functions += [text.point(), _IMPLICIT_STEPS]
    header = [f"{name} = {size}" for name, size in sizes.items()] + [f"DELAYED = {text.observation is not None}"]
    return "\n".join([*header, *(line for f in functions for line in ["", "", *f])]) + "\n"
