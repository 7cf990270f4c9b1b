"""Machine code from plain Python functions that use a small part of the language.

The loops of `cell.loops` and the functions that `cell.rk4_source` writes are read as syntax trees and handed to LLVM
through numba, without numba's own analysis of Python, which takes three times as long as all the rest. Functions that
are called are put in place, and a branch that constants decide against leaves no code.

What may be used: numbers, arrays of them, tuples of constants, arithmetic, comparisons, `and`, `or`, `not`, conditional
expressions, `if`, `for ... in range(...)`, `break`, `continue`, `return`, `len`, `abs`, `min`, `max`, `np.empty`,
`np.zeros`, the functions of `math`, and calls of other such functions. What differs from Python: indices and what `//`
and `%` divide are never negative, a variable is of one type, the name of an array stands for that array alone, and the
variable of a loop ends with it.

Arrays made by `np.empty` and `np.zeros` live on the stack until the compiled function returns. One on the heap begins
at another place of its memory page in every process, and the stack does too. Where both begin at the same place, loads
from one wait for stores to the other ("4 KB aliasing" in Intel's and AMD's optimisation manuals): so a function took
1.0 or 1.4 of its time as long as the process lived. On the stack everything keeps its distance.
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
    """Decorator of a function that Python calls with arguments of these types; its machine code is kept on disk."""
    # No "nnan": it would let the compiler drop the NaN test that marks a missing label.
    fast = {"reassoc", "contract", "arcp", "nsz"}
    decorator: Callable[..., Any] = njit(
        signature, cache=True, fastmath=fast, nogil=True, error_model="numpy", no_cfunc_wrapper=True
    )
    return decorator


def translated(function: Callable[..., Any], names: Mapping[str, Any]) -> Any:
    """A function for `compiled` ones to call, made from a Python one that returns a float or nothing.

    Args:
        function: a function of a module.
        names: what it and those that it calls do not find in their own modules: sizes and other functions.
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
    """The syntax trees of a module's functions."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


@dataclass
class _Frame:
    """A function that is being put in place.

    Attributes:
        function: which.
        stores: how often each name is assigned to.
        bound: names that stay what they are: arrays, constants, arguments.
        variables: where the other names are kept.
        end: where `return` goes.
        result: where what it returns is kept.
    """

    function: FunctionType
    stores: dict[str, int]
    bound: dict[str, Any]
    end: Any
    variables: dict[str, Any] = field(default_factory=dict)
    result: Any = None


class _Translation(Expressions):
    """Puts Python functions into the LLVM function that a machine writes."""

    frame: _Frame | None = None

    def __init__(self, machine: Machine, names: Mapping[str, Any]) -> None:
        super().__init__(machine)
        self.names = names
        self.loops: list[tuple[Any, Any]] = []  # that are open: where `continue` and `break` go

    def call(self, function: Any, arguments: Sequence[Any]) -> Any:
        """Put a function in place; what it returns."""
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
        """Statements one after the other, then on to another block."""
        for statement in body:
            if self.builder.block.is_terminated:
                return
            try:
                self._statement(statement)
            except JointIdError:
                raise
            except Exception as error:
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
        """A loop around what is written inside, with its count and the block where that has to end."""
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
