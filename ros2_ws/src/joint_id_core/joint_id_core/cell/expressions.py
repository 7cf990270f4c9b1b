"""Compilation of expressions in a Python function; `cell.translate` compiles the statements."""

from __future__ import annotations

import ast
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from joint_id_core.cell.machine import BOOL, FLOAT, INT, Block, Machine, kind_of, known


class Expressions(ABC):
    """Evaluates the expressions of a syntax tree: numbers, arrays, tuples, functions and modules.

    The code is written by `machine`, at its current position.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine, self.builder = machine, machine.builder

    @abstractmethod
    def name(self, name: str) -> Any:
        """Return the value of a name."""

    @abstractmethod
    def call(self, function: Any, arguments: Sequence[Any]) -> Any:
        """Inline the call of a Python function and return its result."""

    @abstractmethod
    def loop(self, first: Any, last: Any, step: int) -> AbstractContextManager[tuple[Any, Any]]:
        """Write a loop around the code inside; gives its counter and the block to which the body must branch."""

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        match node:
            case ast.Constant(value):
                return value
            case ast.Name(name):
                return self.name(name)
            case ast.Tuple(elements):
                return tuple(self.value(element) for element in elements)
            case ast.Attribute(value, name):
                return getattr(self.value(value), name)
            case ast.BinOp(left, operation, right):
                return self.machine.operation(type(operation), self.value(left), self.value(right))
            case ast.UnaryOp(ast.USub(), operand):
                return self.machine.negative(self.value(operand))
            case ast.UnaryOp(ast.Not(), operand):
                condition = self.condition(operand)
                return not condition if known(condition) else self.builder.not_(condition)
            case ast.Compare(left, [operation], [right]):
                return self.machine.comparison(type(operation), self.value(left), self.value(right))
            case ast.BoolOp(ast.And(), [first, *rest]):
                others = rest[0] if len(rest) == 1 else ast.BoolOp(ast.And(), rest)
                return self._choice(first, others, ast.Constant(False))
            case ast.BoolOp(ast.Or(), [first, *rest]):
                others = rest[0] if len(rest) == 1 else ast.BoolOp(ast.Or(), rest)
                return self._choice(first, ast.Constant(True), others)
            case ast.IfExp(test, body, orelse):
                return self._choice(test, body, orelse)
            case ast.Subscript():
                return self._element(node)
            case ast.Call():
                return self._call(node)
        raise NotImplementedError(f"{ast.unparse(node)}: a compiled function cannot do this")

    def condition(self, node: ast.expr) -> Any:
        """Return the value of a boolean expression."""
        value = self.value(node)
        if kind_of(value) != BOOL:
            raise TypeError(f"{ast.unparse(node)} is a number, not a condition")
        return value

    def _choice(self, test: ast.expr, body: ast.expr, orelse: ast.expr) -> Any:
        """Return the value of one of two expressions; only the chosen one is evaluated."""
        condition, builder = self.condition(test), self.builder
        if known(condition):
            return self.value(body if condition else orelse)
        branches = [builder.append_basic_block(name) for name in ("then", "else")]
        builder.cbranch(condition, *branches)
        found = []
        for block, node in zip(branches, (body, orelse), strict=True):
            builder.position_at_end(block)
            found.append((self.value(node), builder.block))
        kinds = {kind_of(value) for value, _ in found}
        kind = next(k for k in (FLOAT, INT, BOOL) if k in kinds)
        after, ends = builder.append_basic_block("after"), []
        for value, block in found:
            builder.position_at_end(block)
            ends.append((self.machine.as_kind(kind, value), block))
            builder.branch(after)
        builder.position_at_end(after)
        joined = builder.phi(kind)
        for end in ends:
            joined.add_incoming(*end)
        return joined

    def place(self, node: ast.expr) -> Any:
        """Return the address of an array element."""
        if not isinstance(node, ast.Subscript):
            raise NotImplementedError(f"{ast.unparse(node)}: nothing can be kept there")
        return self.machine.element(self.value(node.value), self._index(node))

    def _index(self, node: ast.Subscript) -> tuple[Any, ...]:
        index = self.value(node.slice)
        return index if isinstance(index, tuple) else (index,)

    def _element(self, node: ast.Subscript) -> Any:
        """Return an element or a part of an array or a tuple."""
        array, index = self.value(node.value), self._index(node)
        if isinstance(array, tuple):
            if known(index[0]):
                return array[index[0]]
            array = self.machine.table(array)
        place = self.machine.element(array, index)
        return place if isinstance(place, Block) else self.builder.load(place)

    def _call(self, node: ast.Call) -> Any:
        function, arguments = self.value(node.func), [self.value(a) for a in node.args]
        if function is len:
            return arguments[0].shape[0]
        if function in (np.empty, np.zeros):
            options = {str(k.arg): self.value(k.value) for k in node.keywords}
            return self._new_array(arguments[0], function is np.zeros, **options)
        if function in (min, max, abs, int) and all(map(known, arguments)):
            return function(*arguments)
        if function in (min, max):
            return self.machine.extreme(ast.Lt if function is min else ast.Gt, arguments)
        if function is abs:
            return self.machine.function(math.fabs, arguments)
        if function is int:
            return self.machine.whole(arguments[0])
        if function is math.isnan:
            return self.builder.fcmp_unordered("uno", arguments[0], arguments[0])
        if getattr(math, function.__name__, None) is function:
            return self.machine.function(function, arguments)
        return self.call(function, arguments)

    def _new_array(self, shape: Any, zero: bool, dtype: type = np.float64) -> Block:
        shape = shape if isinstance(shape, tuple) else (shape,)
        array = self.machine.array(shape, INT if dtype is np.int64 else FLOAT)
        if zero:
            size: Any = 1
            for number in shape:
                size = self.machine.operation(ast.Mult, size, number)
            with self.loop(0, size, 1) as (count, following):
                self.machine.store(0, self.machine.element(Block(array.pointer, (size,)), [count]))
                self.builder.branch(following)
        return array
