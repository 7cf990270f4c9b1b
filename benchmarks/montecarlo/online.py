"""Errors of the estimates of a sliding window."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from engine.fits import LABELS, measured
from engine.windows import MOTION, slide
from simulated import MODEL_2, motion

from montecarlo.draws import Draw, many, of


def run(labels: Sequence[str], cache: Path, seed: int) -> list[Draw]:
    """All estimates of one motion."""
    recording = measured(motion(MOTION, seed, cache), seed, labels)
    return [of(estimate, MODEL_2.values(), seed, took.cpu_s) for estimate, took in slide(recording)]


def measure(seeds: Sequence[int], cache: Path, workers: int) -> dict[str, list[Draw]]:
    """By labels, the draws of all motions. Those of one motion share what they remember."""
    return {
        name: [draw for one in many(partial(run, labels, cache), seeds, workers) for draw in one]
        for name, labels in LABELS.items()
    }
