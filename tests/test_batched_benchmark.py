"""The benchmark of the batched network: its rows are of the same results, and a missing GPU is said."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="the batched network needs torch, which is not installed")

import batched  # noqa: E402

pytestmark = pytest.mark.long


def test_a_table_compares_the_same_passes_and_searches():
    passes, starts = list(batched.of_passes((4,), 1)), list(batched.of_starts(2, cores=2))
    assert [row.batch for row in passes] == [4] * len(passes) and passes[0].ratio == starts[0].ratio == 1.0
    assert all(0.0 < row.difference < 1e-9 for row in passes[1:])
    assert starts[0].difference == 0.0 and all(0.0 <= row.difference <= 1.0 for row in starts)  # shares
    text = batched.table(passes, starts)
    assert ("no GPU here" in text) == (not torch.cuda.is_available())
    assert text.count("| compiled kernel, one core |") == 2 and "| compiled kernel, 2 cores |" in text
    assert starts[-1].difference == 0.0 and starts[-1].best == starts[0].best  # the same searches


def test_results_of_another_machine_say_which_one():
    row = batched.Row("torch, a card", 100, 5.0, 0.2, 0.2, 1e-13, 3.0)
    text = batched.table([row], [batched.Row("torch, a card", 10, 1.0, 2.0, 2.0, 0.5, 0.0, 0.6)], "16 cores, a card.")
    assert text.startswith("16 cores, a card.") and "no GPU here" not in text
    assert "| torch, a card | 10 | 1 | 2 | 2 | 50.0% | 60.0% |" in text
