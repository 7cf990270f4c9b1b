"""Numbers and arrays of a function that is being compiled, for `cell.translate`.

A number that is known at compile time is a Python number. Any other number is an LLVM value: float, integer or boolean.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils

FLOAT, INT, BOOL = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
ALIGN_BYTES = 64  # a cache line: loading a vector that crosses a line boundary costs twice as much

# By operator: the Python function, and the names of the LLVM instructions for floats and for integers.
ARITHMETIC: dict[type, tuple[Callable[..., Any], str, str]] = {
    ast.Add: (operator.add, "fadd", "add"),
    ast.Sub: (operator.sub, "fsub", "sub"),
    ast.Mult: (operator.mul, "fmul", "mul"),
    ast.Div: (operator.truediv, "fdiv", ""),
    ast.Pow: (operator.pow, "", ""),
    ast.FloorDiv: (operator.floordiv, "", "sdiv"),
    ast.Mod: (operator.mod, "", "srem"),
}
COMPARISONS: dict[type, tuple[Callable[..., Any], str]] = {
    ast.Lt: (operator.lt, "<"),
    ast.LtE: (operator.le, "<="),
    ast.Gt: (operator.gt, ">"),
    ast.GtE: (operator.ge, ">="),
    ast.Eq: (operator.eq, "=="),
    ast.NotEq: (operator.ne, "!="),
}


@dataclass(frozen=True)
class Block:
    """A contiguous array: pointer to its first number, and its shape. The last index varies fastest (C order)."""

    pointer: Any
    shape: tuple[Any, ...]


def known(value: Any) -> bool:
    """Return whether a number is known at compile time."""
    return isinstance(value, int | float)


def kind_of(value: Any) -> Any:
    """Return the type of a number."""
    if known(value):
        return FLOAT if isinstance(value, float) else BOOL if isinstance(value, bool) else INT
    return value.type


class Machine:
    """Emits LLVM code for operations on numbers and arrays, at the current position of a builder."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder
        self._tables: dict[tuple[Any, ...], Block] = {}

    def received(self, kind: Any, value: Any) -> Any:
        """Return a number or an array that numba passes as an argument."""
        if not isinstance(kind, types.Array):
            return value
        array = self.context.make_array(kind)(self.context, self.builder, value)
        return Block(array.data, tuple(cgutils.unpack_tuple(self.builder, array.shape)))

    def as_kind(self, kind: Any, value: Any) -> Any:
        """Convert a number to an LLVM value of this type."""
        own = kind_of(value)
        if own not in {FLOAT: (FLOAT, INT, BOOL), INT: (INT, BOOL), BOOL: (BOOL,)}[kind]:
            raise TypeError(f"a number of type {own} is used as {kind}")
        if known(value):
            return ir.Constant(kind, float(value) if kind == FLOAT else int(value))
        if own == kind:
            return value
        if kind == INT:
            return self.builder.zext(value, INT)
        return self.builder.uitofp(value, FLOAT) if own == BOOL else self.builder.sitofp(value, FLOAT)

    def variable(self, kind: Any) -> Any:
        """Allocate memory for a number and return its address."""
        with self.builder.goto_entry_block():
            return self.builder.alloca(kind)

    def store(self, value: Any, place: Any) -> None:
        """Store a number, converted to the type of its memory."""
        self.builder.store(self.as_kind(place.type.pointee, value), place)

    # --- arithmetic

    def operation(self, kind: type, a: Any, b: Any) -> Any:
        """Apply a Python operator to two numbers."""
        python, of_floats, of_ints = ARITHMETIC[kind]
        if known(a) and known(b):
            return python(a, b)
        if kind is ast.Pow:
            return self._power(a, b) if isinstance(b, int) else self.function(math.pow, [a, b])
        if kind is ast.Div or FLOAT in (kind_of(a), kind_of(b)):
            return getattr(self.builder, of_floats)(self.as_kind(FLOAT, a), self.as_kind(FLOAT, b))
        flags = () if of_ints in ("sdiv", "srem") else ("nsw",)
        return getattr(self.builder, of_ints)(self.as_kind(INT, a), self.as_kind(INT, b), flags=flags)

    def _power(self, a: Any, exponent: int) -> Any:
        """Return an integer power, by repeated squaring."""
        result: Any = 1.0
        left = abs(exponent)
        while left:
            if left % 2:
                result = a if result == 1.0 else self.operation(ast.Mult, result, a)
            left //= 2
            a = self.operation(ast.Mult, a, a) if left else a
        return self.operation(ast.Div, 1.0, result) if exponent < 0 else result

    def negative(self, value: Any) -> Any:
        """Return -value."""
        if known(value):
            return -value
        return self.builder.fneg(value) if value.type == FLOAT else self.builder.neg(value)

    def comparison(self, kind: type, a: Any, b: Any) -> Any:
        """Apply a Python comparison to two numbers."""
        python, sign = COMPARISONS[kind]
        if known(a) and known(b):
            return python(a, b)
        if FLOAT in (kind_of(a), kind_of(b)):
            compare = self.builder.fcmp_unordered if sign == "!=" else self.builder.fcmp_ordered
            return compare(sign, self.as_kind(FLOAT, a), self.as_kind(FLOAT, b))
        return self.builder.icmp_signed(sign, self.as_kind(INT, a), self.as_kind(INT, b))

    def extreme(self, kind: type, values: Sequence[Any]) -> Any:
        """Return the smallest number (`kind` ast.Lt) or the largest number (ast.Gt)."""
        found, *others = values
        common = FLOAT if FLOAT in map(kind_of, values) else INT
        for value in others:
            better = self.comparison(kind, value, found)
            found = self.builder.select(better, self.as_kind(common, value), self.as_kind(common, found))
        return found

    def whole(self, value: Any) -> Any:
        """Return a number without its fraction as an integer, which must be able to hold it."""
        return self.builder.fptosi(value, INT) if kind_of(value) == FLOAT else self.as_kind(INT, value)

    def function(self, function: Any, arguments: Sequence[Any]) -> Any:
        """Call a function of `math` in numba's implementation."""
        signature = types.float64(*[types.float64] * len(arguments))
        values = [self.as_kind(FLOAT, a) for a in arguments]
        return self.context.get_function(function, signature)(self.builder, values)

    # --- arrays

    def array(self, shape: Sequence[Any], kind: Any) -> Block:
        """Allocate an uninitialised array on the stack. Outside of loops its shape need not be constant."""
        size: Any = 1
        for number in shape:
            size = self.operation(ast.Mult, size, number)
        if not known(size):
            pointer = self.builder.alloca(kind, size)
            pointer.align = ALIGN_BYTES
            return Block(pointer, tuple(shape))
        with self.builder.goto_entry_block():
            space = self.builder.alloca(ir.ArrayType(kind, size))
            space.align = ALIGN_BYTES
            return Block(self.builder.bitcast(space, kind.as_pointer()), tuple(shape))

    def table(self, numbers: tuple[Any, ...]) -> Block:
        """Return a constant array with the numbers of a tuple of floats, or of nested tuples."""
        if numbers not in self._tables:
            values = np.array(numbers, dtype=float)
            constant = ir.Constant(ir.ArrayType(FLOAT, values.size), values.ravel().tolist())
            module = self.builder.module
            place = cgutils.global_constant(module, module.get_unique_name("table"), constant)
            self._tables[numbers] = Block(place.bitcast(FLOAT.as_pointer()), values.shape)
        return self._tables[numbers]

    def element(self, array: Block, index: Sequence[Any]) -> Any:
        """Return the address of a number; with fewer indices than dimensions, return that part of the array."""
        place: Any = 0
        for number, size in zip(index, array.shape, strict=False):
            place = self.operation(ast.Add, self.operation(ast.Mult, place, size), number)
        rest = array.shape[len(index) :]
        for size in rest:
            place = self.operation(ast.Mult, place, size)
        pointer = self.builder.gep(array.pointer, [self.as_kind(INT, place)], inbounds=True)
        return Block(pointer, rest) if rest else pointer
