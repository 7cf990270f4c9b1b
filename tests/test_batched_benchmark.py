"""The benchmark of the batched network: its rows are of the same results, and a missing GPU is said."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="the batched network needs torch, which is not installed")

import batched  # noqa: E402

pytestmark = pytest.mark.long


def test_a_table_compares_the_same_passes_and_searches():
    passes, starts = batched.of_passes((4,), 1), batched.of_starts(2)
    assert [row.batch for row in passes] == [4] * len(passes) and passes[0].ratio == starts[0].ratio == 1.0
    assert all(0.0 < row.difference < 1e-9 for row in passes[1:])
    assert starts[0].difference == 0.0 and all(0.0 <= row.difference <= 1.0 for row in starts)  # shares
    text = batched.table(passes, starts)
    assert ("no GPU here" in text) == (not torch.cuda.is_available())
    assert text.count("| compiled kernel, one core |") == 2
