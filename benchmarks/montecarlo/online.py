"""Errors of a sliding window's estimates: of windows that are fitted as a whole, and of estimates that are extended."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from engine.fits import LABELS, measured
from engine.windows import MOTION, slide
from simulated import MODEL_2, motion

from montecarlo.draws import Draw, many, of

KINDS = ("extended", "fitted as a whole")


def run(labels: Sequence[str], cache: Path, seed: int) -> list[tuple[str, Draw]]:
    """All estimates of one motion, with their kinds."""
    recording = measured(motion(MOTION, seed, cache), seed, labels)
    found = []
    for estimate, took in slide(recording):
        kind = KINDS[estimate.predictions is not None]
        found.append((kind, of(estimate, MODEL_2.values(), seed, took.cpu_s)))
    return found


def measure(seeds: Sequence[int], cache: Path, workers: int) -> dict[str, list[Draw]]:
    """By labels and kind, the draws of all motions. Those of one motion share what they remember."""
    found: dict[str, list[Draw]] = {}
    for name, labels in LABELS.items():
        runs = many(partial(run, labels, cache), seeds, workers)
        for kind in KINDS:
            found[f"{name}, {kind}"] = [draw for one in runs for k, draw in one if k == kind]
    return found
