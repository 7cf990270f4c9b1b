"""Cases of a test of which only the first ones run in `make test`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_quick(cases: Iterable[Any], quick: int = 1) -> list[Any]:
    """Return the cases, all but the first ones marked `long`: more seeds or sizes of what one case shows already.

    A tuple is the values of several arguments.
    """
    values = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*value, marks=[pytest.mark.long] if k >= quick else []) for k, value in enumerate(values)]
