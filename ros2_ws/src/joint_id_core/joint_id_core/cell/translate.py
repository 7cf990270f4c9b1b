"""Compile plain Python functions that use a small part of the language to machine code.

The loops of `cell.loops` and the functions that `cell.rk4_source` writes are read as syntax trees and passed to LLVM
through numba. This skips numba's own analysis of Python, which takes three times as long as all the rest. Functions
that are called are inlined. A branch whose condition is a constant false produces no code.

Supported: numbers, arrays of numbers, tuples of constants, arithmetic, comparisons, `and`, `or`, `not`, conditional
expressions, `if`, `for ... in range(...)`, `break`, `continue`, `return`, `len`, `abs`, `min`, `max`, `int`,
`np.empty`, `np.zeros`, the functions of `math`, and calls of other such functions.

Differences from Python: indices and the operands of `//` and `%` must not be negative, a variable keeps its type, the
name of an array cannot be assigned again, and the variable of a loop does not exist after the loop.

Arrays from `np.empty` and `np.zeros` are on the stack until the compiled function returns. The reason is "4 KB
aliasing" (see Intel's and AMD's optimisation manuals): if two arrays have the same offset in their memory pages, loads
from one wait for stores to the other. The offsets of heap and stack differ from process to process. So with arrays on
the heap a function took 1.0 or 1.4 times its usual time, during the whole life of a process. On the stack the distances
between arrays are fixed.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from joint_id_core.cell.expressions import Expressions
from joint_id_core.cell.machine import FLOAT, INT, Block, Machine, kind_of, known
from joint_id_core.errors import JointIdError


def compiled(signature: str) -> Callable[..., Any]:
    """Return a decorator that compiles a function for arguments of these types; the machine code is cached on disk."""
    # Without "nnan": it would allow the compiler to remove the NaN test for a missing label.
    fast = {"reassoc", "contract", "arcp", "nsz"}
    decorator: Callable[..., Any] = njit(
        signature, cache=True, fastmath=fast, nogil=True, error_model="numpy", no_cfunc_wrapper=True
    )
    return decorator


def translated(function: Callable[..., Any], names: Mapping[str, Any]) -> Any:
    """Translate a Python function that returns a float or None to one that `compiled` functions can call.

    Args:
        function: a function of a module.
        names: names that are missing in the modules of this function and of those that it calls: sizes and functions.
    """

    @intrinsic
    def call(_context: Any, *given: Any) -> Any:
        result = types.float64 if function.__annotations__["return"] == "float" else types.none

        def code(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            machine = Machine(context, builder)
            values = cgutils.unpack_tuple(builder, arguments[0])
            received = [machine.received(kind, value) for kind, value in zip(given, values, strict=True)]
            returned = _Translation(machine, names).call(function, received)
            return context.get_dummy_value() if result is types.none else returned

        return result(types.Tuple(given)), code

    return call


@lru_cache(maxsize=64)
def _functions(module: str) -> dict[str, ast.FunctionDef]:
    """Return the syntax trees of a module's functions by name."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


@dataclass
class _Frame:
    """A function that is being inlined.

    Attributes:
        function: the function.
        stores: number of assignments to each name.
        bound: names that are never assigned again: arrays, constants, arguments.
        end: block to which `return` branches.
        variables: addresses of the other names.
        result: address of the returned value.
    """

    function: FunctionType
    stores: dict[str, int]
    bound: dict[str, Any]
    end: Any
    variables: dict[str, Any] = field(default_factory=dict)
    result: Any = None


class _Translation(Expressions):
    """Inlines Python functions into the LLVM function that a machine writes."""

    frame: _Frame | None = None

    def __init__(self, machine: Machine, names: Mapping[str, Any]) -> None:
        super().__init__(machine)
        self.names = names
        self.loops: list[tuple[Any, Any]] = []  # open loops: blocks to which `continue` and `break` branch

    def call(self, function: Any, arguments: Sequence[Any]) -> Any:
        """Inline the call of a function and return its result."""
        node = _functions(function.__module__)[function.__name__]
        stores: dict[str, int] = {}
        for part in ast.walk(node):
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                stores[part.id] = stores.get(part.id, 0) + 1
        given = dict(zip((a.arg for a in node.args.args), arguments, strict=True))
        outer, self.frame = self.frame, _Frame(function, stores, given, self.builder.append_basic_block("end"))
        for name in given.keys() & stores.keys():
            stores[name] += 1
            self._store_name(name, given.pop(name))
        self._body(node.body, self.frame.end)
        self.builder.position_at_end(self.frame.end)
        result, self.frame = self.frame.result, outer
        return None if result is None else self.builder.load(result)

    # --- names

    def name(self, name: str) -> Any:
        frame = self._here
        if name in frame.variables:
            return self.builder.load(frame.variables[name])
        for names in (frame.bound, frame.function.__globals__, self.names, vars(builtins)):
            if name in names:
                return names[name]
        raise NameError(f"{name} is not known")

    def _store_name(self, name: str, value: Any) -> None:
        frame = self._here
        if isinstance(value, Block) or (known(value) and frame.stores[name] == 1):
            if name in frame.variables or name in frame.bound:
                raise TypeError(f"{name} is an array, and was something else")
            frame.bound[name] = value
            return
        if name not in frame.variables:
            frame.variables[name] = self.machine.variable(kind_of(value))
        self.machine.store(value, frame.variables[name])

    @property
    def _here(self) -> _Frame:
        assert self.frame is not None
        return self.frame

    # --- statements

    def _body(self, body: Sequence[ast.stmt], then: Any) -> None:
        """Write statements one after the other, then a branch to the block `then`."""
        for statement in body:
            if self.builder.block.is_terminated:
                return
            try:
                self._statement(statement)
            except JointIdError:
                raise
            except Exception as error:  # whatever it is: the author of a loop needs its line
                function = self._here.function
                raise JointIdError(
                    f"{function.__module__}.{function.__name__}, line {statement.lineno}: {error}"
                ) from error
        if not self.builder.block.is_terminated:
            self.builder.branch(then)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(ast.Constant()):  # a docstring
                pass
            case ast.Expr(value):
                self.value(value)
            case ast.Assign([ast.Tuple(targets)], ast.Tuple(values)):
                for target, value in zip(targets, [self.value(v) for v in values], strict=True):
                    self._assign(target, value)
            case ast.Assign([target], value):
                self._assign(target, self.value(value))
            case ast.AugAssign(ast.Name(name), operation, value):
                self._store_name(name, self.machine.operation(type(operation), self.name(name), self.value(value)))
            case ast.AugAssign(ast.Subscript() as target, operation, value):
                place = self.place(target)
                old = self.builder.load(place)
                self.machine.store(self.machine.operation(type(operation), old, self.value(value)), place)
            case ast.If(test, body, orelse):
                self._if(self.condition(test), body, orelse)
            case ast.For(ast.Name(name), ast.Call(ast.Name("range"), limits), body):
                self._for(name, [self.value(limit) for limit in limits], body)
            case ast.Return(value):
                self._return(value)
            case ast.Break():
                self.builder.branch(self.loops[-1][1])
            case ast.Continue():
                self.builder.branch(self.loops[-1][0])
            case ast.Pass():
                pass
            case _:
                raise NotImplementedError(f"{ast.unparse(node)}: a compiled function cannot do this")

    def _assign(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Name):
            self._store_name(target.id, value)
        else:
            self.machine.store(value, self.place(target))

    def _return(self, node: ast.expr | None) -> None:
        frame = self._here
        if node is not None:
            value = self.value(node)
            frame.result = frame.result or self.machine.variable(FLOAT)
            self.machine.store(value, frame.result)
        self.builder.branch(frame.end)

    def _if(self, condition: Any, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]) -> None:
        after = self.builder.append_basic_block("after")
        if known(condition):
            self._body(body if condition else orelse, after)
        else:
            branches = [self.builder.append_basic_block(name) for name in ("then", "else")]
            self.builder.cbranch(condition, *branches)
            for block, statements in zip(branches, (body, orelse), strict=True):
                self.builder.position_at_end(block)
                self._body(statements, after)
        self.builder.position_at_end(after)

    def _for(self, name: str, limits: Sequence[Any], body: Sequence[ast.stmt]) -> None:
        first, last, step = (0, *limits, 1) if len(limits) == 1 else (*limits, 1)[:3]
        with self.loop(first, last, step) as (count, following):
            self._here.bound[name] = count
            self._body(body, following)
        del self._here.bound[name]

    @contextmanager
    def loop(self, first: Any, last: Any, step: int) -> Iterator[tuple[Any, Any]]:
        """Write a loop around the code inside; gives its counter and the block to which the body must branch."""
        builder = self.builder
        counter = self.machine.variable(INT)
        self.machine.store(first, counter)
        last = self.machine.as_kind(INT, last)
        test, body, following, after = (builder.append_basic_block(n) for n in ("test", "body", "following", "after"))
        builder.branch(test)
        builder.position_at_end(test)
        count = builder.load(counter)
        builder.cbranch(builder.icmp_signed("<" if step > 0 else ">", count, last), body, after)
        builder.position_at_end(body)
        self.loops.append((following, after))
        yield count, following
        self.loops.pop()
        builder.position_at_end(following)
        builder.store(builder.add(count, ir.Constant(INT, step), flags=("nsw",)), counter)
        builder.branch(test)
        builder.position_at_end(after)
