"""Work space on the stack, for compiled functions.

An array on the heap begins at another place of its memory page in every process, and the stack does too. Where both
begin at the same place, loads from one wait for stores to the other ("4 KB aliasing" in Intel's and AMD's optimisation
manuals): so a function took 1.0 or 1.4 of its time as long as the process lived. On the stack everything keeps its
distance, and the compiler knows that no other array begins there.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

ALIGN_BYTES = 64  # a cache line: a vector that crosses one costs twice as much to load


@intrinsic(prefer_literal=True)
def on_stack(_context: Any, size: Any) -> Any:
    """Address of `size` numbers, a constant, that live until the function returns: use as `carray(on_stack(N), N)`.

    They are not initialised.
    """
    count = size.literal_value

    def code(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        with builder.goto_entry_block():
            space = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
            space.align = ALIGN_BYTES
        return builder.bitcast(space, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(size), code
