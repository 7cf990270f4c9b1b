"""The benchmark of batches: its figures follow from what it measures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from batch import Figures, measure

FIGURES = Figures(1000, 2, 0.10, 0.11, 0.125, 0.0625, 3.0, (80.0, 81.0), (200.0, 201.0))


def test_the_share_is_that_of_the_same_work_in_one_process() -> None:
    assert FIGURES.share == pytest.approx(0.8) and FIGURES.wall_share == pytest.approx(0.88)
    table = FIGURES.table()
    assert "| overhead a bag | 25 ms |" in table and "**0.80**" in table and "80 -> 81 MB" in table
    assert "| 960 |" in table and replace(FIGURES, bags=7).table().startswith("| 7 bags |")


@pytest.mark.long
def test_a_small_run_measures_every_figure(tmp_path: Path) -> None:
    figures = measure(tmp_path, 4, 2, 1)
    assert (figures.bags, figures.jobs) == (4, 2)
    assert 0.0 < figures.alone_cpu_s < figures.batch_cpu_s and figures.batch_wall_s > 0.0
    assert min(*figures.leader_mb, *figures.worker_mb) > 10.0
