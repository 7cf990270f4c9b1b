"""Progress is told on anything that takes longer than a moment, also where the output is no terminal."""

from __future__ import annotations

import time

import pytest

from joint_id_core.cli import output
from joint_id_core.cli.output import Progress
from joint_id_core.estimators import HPinn

from .online_motion import MODEL, motion


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(output, "QUIET_S", 0.2)
    monkeypatch.setattr(output, "PACE_S", 0.2)


def test_a_short_step_says_nothing(quick, capsys):
    with Progress() as progress:
        progress("reading")
    assert capsys.readouterr() == ("", "")


def test_a_long_step_is_told_once_and_the_next_one_too(quick, capsys):
    with Progress() as progress:
        progress("compiling x")
        time.sleep(0.7)
        progress("1 of 2 joints, about 3 s left")
        time.sleep(0.5)
    out, err = capsys.readouterr()
    assert not out and err.splitlines() == ["joint-id: compiling x", "joint-id: 1 of 2 joints, about 3 s left"]


@pytest.mark.long
def test_a_training_tells_how_far_it_is_and_how_long_it_takes(monkeypatch):
    pytest.importorskip("torch", reason="the hpinn needs torch")
    from joint_id_core.estimators.hpinn import training

    monkeypatch.setattr(training, "TELL_S", 0.0)
    told: list[str] = []
    found = HPinn(epochs=20).fit(MODEL, motion(2.0), None, told.append)
    assert any(text.startswith("epoch 10 of 20, loss ") and text.endswith(" s left") for text in told)
    assert len(found.losses) == 20 and found.losses[-1] <= found.losses[0]
    assert [axis.get_xlabel() for axis in found.plot().axes].count("epoch") == 1
