"""Fits of one case to many draws of its noise, in processes of their own."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from simulated import motion, start

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.results.estimate import Estimate
from montecarlo.cases import FACTOR, Case

T = TypeVar("T")

BEYOND_NOISE = 8.0  # standard deviations: no noise, but another minimum or a wrong model


@dataclass(frozen=True)
class Draw:
    """One fit.

    Attributes:
        seed: of the noise and of the start values.
        status: how the fit ended.
        coloured: whether it says that residuals are not white.
        misfit: whether it says that residuals show something the model lacks, which its intervals then contain.
        cpu_s: processor time of the fit in s.
        errors, sigmas: relative to the truth, absolute where that is zero, by parameter; empty without a result.
    """

    seed: int
    status: str
    coloured: bool
    misfit: bool
    cpu_s: float
    errors: Mapping[str, float]
    sigmas: Mapping[str, float]

    @property
    def converged(self) -> bool:
        """Whether the fit says so."""
        return self.status == "converged"

    @property
    def far(self) -> bool:
        """Whether an error is beyond what noise does."""
        return any(not abs(self.errors[name]) < BEYOND_NOISE * self.sigmas[name] for name in self.errors)


def recorded(case: Case, seed: int, cache: Path) -> Recording:
    """What the sensors show in one draw: labels and inputs."""
    inputs = case.motion.inputs
    return case.sensors.measure(motion(case.motion, seed, cache), seed, keep=(*case.labels, *inputs))


def draw(case: Case, cache: Path, seed: int) -> Draw:
    """Fit one draw."""
    recording, values = recorded(case, seed, cache), start(case.model, seed, FACTOR)
    begun = time.process_time()
    estimate = fit(case.model, recording, ParameterSettings(values))
    return of(estimate, case.model.values(), seed, time.process_time() - begun)


def of(estimate: Estimate, truth: Mapping[str, float], seed: int, cpu_s: float) -> Draw:
    """An estimate beside the truth."""
    rows = [estimate[name] for name in estimate.free if np.isfinite(estimate[name].std_dev)]
    size = {row.name: truth[row.name] or 1.0 for row in rows}
    errors = {row.name: (row.value - truth[row.name]) / size[row.name] for row in rows}
    sigmas = {row.name: row.std_dev / size[row.name] for row in rows}
    says = " ".join(estimate.notes)
    return Draw(seed, estimate.status.value, "not white" in says, "residuals show" in says, cpu_s, errors, sigmas)


def many(function: Callable[[int], T], seeds: Sequence[int], workers: int) -> list[T]:
    """A result for each seed; `function` is one of a module with its other arguments bound."""
    if workers == 1:
        return [function(seed) for seed in seeds]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        return list(pool.map(function, seeds, chunksize=max(1, len(seeds) // (8 * workers))))


def measure(case: Case, seeds: Sequence[int], cache: Path, workers: int) -> list[Draw]:
    """Fits of a case."""
    return many(partial(draw, case, cache), seeds, workers)
