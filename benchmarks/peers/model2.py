"""What the peers share: Model 2 on the library of each, the data of a fit, and what a fit returns.

Every peer knows the standard deviation of the labels, estimates the nine parameters in the logarithm, and the start
state with them: a first label of the motor velocity that is off by its 0.1 rad/s alone moves the end of an open-loop
simulation by some 50 standard deviations of the link position.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import build

MODEL = build("harmonic_drive")
FREE = tuple(p.name for p in MODEL.parameters if not p.fixed)
STATES = len(MODEL.states)

# Smoothing velocities of Coulomb friction and RK4 steps a sample of 2 ms. With these |lambda h| is 1.9 where the true
# joint sticks (tau_fm / (w_sm J_m) = 3800 1/s): stable. Sharper smoothing needs more steps in every sample: peers
# have one number for all. Ten times softer smoothing moves k_1 by 2 %.
SMOOTHING = {"w_sm": 0.1, "w_sq": 1e-3}  # rad/s
SUBSTEPS = 4

# Shares of the record that a peer with single shooting fits one after the other, each from the last one's result, with
# rough tolerances before the last. From starts off by up to three, Levenberg-Marquardt on the whole record at once came
# to the truth in 2 of 8 runs, with shares of 0.1 and 1 in 7, with these in 8, and sooner.
HORIZONS = (0.05, 0.1, 0.2, 0.4, 1.0)

# Where a fit may stop: a step in the logarithms, and a share of the cost that an iteration still gains. More decimals
# are below the noise of the data.
STEP_TOLERANCE, COST_TOLERANCE = 1e-4, 1e-5
ROUGH_STEP_TOLERANCE, ROUGH_COST_TOLERANCE = 1e-2, 1e-2
MAX_ITERATIONS, ROUGH_MAX_ITERATIONS = 200, 50


@dataclass(frozen=True)
class Data:
    """A recording of Model 2 with all states measured.

    Attributes:
        recording: all states and inputs, without NaN, T samples.
        sigma: standard deviation of the labels, shape (4,), SI units.
        torque_noise: standard deviation of the measured torque in Nm, held from sample to sample.
    """

    recording: Recording
    sigma: Array
    torque_noise: float

    @cached_property
    def u(self) -> Array:
        """Inputs, shape (T, 2), each held until the next sample."""
        return np.column_stack([self.recording[name] for name in MODEL.input_names])

    @cached_property
    def y(self) -> Array:
        """Labels, shape (T, 4)."""
        return np.column_stack([self.recording[name] for name in MODEL.state_names])

    def first(self, share: float) -> Data:
        """The first share of the record, in (0, 1]; at least as many samples as there are unknowns."""
        samples = max(len(FREE) + STATES, round(share * len(self.recording)))
        return replace(self, recording=self.recording.slice(0, samples))


@dataclass(frozen=True)
class Fit:
    """What a peer returns.

    Attributes:
        values: the free parameters, SI units.
        seconds: processor time of the fit in s, without set-up.
        setup_s: processor time in s of what is compiled once and then serves every fit to records of this length.
        iterations: steps of the optimiser.
        finished: False when it ended at a limit, of time or of iterations, or gave up.
    """

    values: dict[str, float]
    seconds: float
    setup_s: float
    iterations: int
    finished: bool


class Ops:
    """The functions a derivative may call (`models.Ops`), from a library that has NumPy's; friction is smoothed."""

    def __init__(self, library: Any) -> None:
        self.sin, self.cos, self.exp, self.asinh = library.sin, library.cos, library.exp, library.asinh
        self._tanh = library.tanh

    def direction(self, velocity: str, w: Any, w_s: Any) -> Any:
        """tanh(w / w_s), as in the library's own estimator."""
        return self._tanh(w / w_s)


def processor_s() -> float:
    """Processor time of this process and of its children that have ended (compilers), in s.

    On a machine that does nothing else this is wall time, because a benchmark keeps to one core; on one that is
    shared it is what wall time would have been.
    """
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def unknowns(start: Mapping[str, float]) -> Array:
    """Start of the vector that is estimated, shape (13,).

    Logarithms of the free parameters, then the start state as its distance from the first labels in their standard
    deviations.
    """
    return np.concatenate([np.log([start[name] for name in FREE]), np.zeros(STATES)])


def values(z: Any) -> dict[str, float]:
    """Free parameters in SI units, from a vector that begins with their logarithms."""
    return dict(zip(FREE, np.exp(np.asarray(z, dtype=float).ravel()[: len(FREE)]).tolist(), strict=True))


def parameters(free: Sequence[Any]) -> SimpleNamespace:
    """All parameters by attribute: `free` in the order of `FREE`, friction smoothed by `SMOOTHING`."""
    return SimpleNamespace(**{**MODEL.values(SMOOTHING), **dict(zip(FREE, free, strict=True))})


def rk4(slope: Callable[[Any], Any], x: Any, h: Any) -> Any:
    """One classic Runge-Kutta step of `h` in s; `x` and its `slope` are vectors of any library."""
    k_1 = slope(x)
    k_2 = slope(x + 0.5 * h * k_1)
    k_3 = slope(x + 0.5 * h * k_2)
    k_4 = slope(x + h * k_3)
    return x + (h / 6.0) * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


def horizons(data: Data) -> Iterator[tuple[Data, bool]]:
    """The beginning of a record, longer and longer, and whether it is the whole."""
    for share in HORIZONS:
        yield data.first(share), share == HORIZONS[-1]
