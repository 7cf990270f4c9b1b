"""Complete fits of Model 2 beside one rollout in C++ of the same window: from starts that are a factor off."""

from __future__ import annotations

import cProfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from simulated import MODEL_2, SENSORS, ClosedLoop, Torque, motion, start

from engine.timing import Times, in_turn
from engine.yardstick import Rollout, Yardstick, at_steps, rollouts
from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.substeps import steps_of
from joint_id_core.results.estimate import Estimate

TARGET = 40.0
FACTOR = 3.0
SEEDS = tuple(range(1000, 1010))
LABELS = {
    "all four states": MODEL_2.state_names,
    "link position, motor velocity": ("link_position", "motor_velocity"),
}
NOISY = ClosedLoop(torque=Torque(white=0.003))
# Where the time of a fit goes: functions by what they do, of the generated kernel and of the engine; none calls another
PARTS = {
    "passes of the innovations form, compiled": ("kernel.py", "innovations"),
    "information of the noise levels, compiled": ("gains.py", "noise_information"),
    "checking and preparing the data": ("fit_data.py", "prepare"),
    "predictions, verdicts, the result": ("fit.py", "estimate_of"),
}


@dataclass(frozen=True)
class FitTimes:
    """Times of a fit, and of C++ on the same window at the same number of steps.

    Attributes:
        labels, seed: what was measured, of which motion and from which start.
        status: how the fit ended.
        iterations: of all its stages.
        steps: mean number of RK4 steps a sample in the last stage.
        fit, cpp: times.
    """

    labels: str
    seed: int
    status: str
    iterations: int
    steps: float
    fit: Times
    cpp: Times

    @property
    def ratio(self) -> float:
        """Fit to C++, processor time."""
        return self.fit.cpu_s / self.cpp.cpu_s


def measured(true: Recording, seed: int, labels: Sequence[str] = MODEL_2.state_names) -> Recording:
    """What the sensors show of a motion: some states, and the torque."""
    return SENSORS.measure(true, seed, keep=(*labels, "torque"))


def mean_steps(estimate: Estimate, recording: Recording, true: Recording) -> float:
    """RK4 steps a sample at the end of a fit of Model 2, more of them where friction turns."""
    data, kernel = prepare(MODEL_2, recording), compile_model(MODEL_2)
    p = np.array([estimate.values[name] for name in MODEL_2.parameter_names])
    return float(np.mean(steps_of(data, kernel, p, states_of(true), estimate.substeps)[:-1]))


def states_of(true: Recording) -> Array:
    """All states of Model 2, shape (T, 4)."""
    return np.column_stack([true[name] for name in MODEL_2.state_names])


def rollout_of(yardstick: Yardstick, true: Recording) -> Callable[[int], Rollout]:
    """Rollouts in C++ of a window, by their number of steps a sample."""
    return lambda steps: yardstick.rollout(
        MODEL_2, states_of(true)[0], true["torque"], MODEL_2.values(), true.period, steps
    )


def measure(cache: Path, rounds: int) -> list[FitTimes]:
    """Fit every motion from its own start, `rounds` times, with C++ in turn. Motions come from `cache`."""
    yardstick, found = Yardstick(), []
    for name, labels in LABELS.items():
        for seed in SEEDS:
            true = motion(NOISY, seed, cache)
            found.append(compared(name, seed, measured(true, seed, labels), true, yardstick, rounds))
    return found


def compared(
    name: str, seed: int, recording: Recording, true: Recording, yardstick: Yardstick, rounds: int
) -> FitTimes:
    """Times of one fit; `name` says which labels."""
    values = start(MODEL_2, seed, FACTOR)
    estimate = fit(MODEL_2, recording, ParameterSettings(values))
    steps = mean_steps(estimate, recording, true)
    calls: dict[str, Callable[[], object]] = {
        "fit": lambda: fit(MODEL_2, recording, ParameterSettings(values)),
        **rollouts(rollout_of(yardstick, true), steps),
    }
    times = in_turn(calls, rounds)
    cpp = at_steps(times, steps)
    return FitTimes(name, seed, estimate.status.value, estimate.iterations, steps, times["fit"], cpp)


def shares(cache: Path, rounds: int) -> dict[str, float]:
    """Shares of the time of fits with all states, by cProfile, which itself slows the rest: `PARTS`, what is left.

    Raises:
        JointIdError: a function of `PARTS` has another name now.
    """
    tasks = []
    for seed in SEEDS:
        tasks.append((measured(motion(NOISY, seed, cache), seed), ParameterSettings(start(MODEL_2, seed, FACTOR))))
        fit(MODEL_2, *tasks[-1])
    profile = cProfile.Profile()
    for recording, settings in rounds * tasks:
        profile.runcall(fit, MODEL_2, recording, settings)
    times = {
        (Path(entry.code.co_filename).name, entry.code.co_name): entry.totaltime
        for entry in profile.getstats()
        if not isinstance(entry.code, str)
    }
    total = times["__init__.py", "fit"]
    gone = [f"{name} of {file}" for file, name in PARTS.values() if (file, name) not in times]
    if gone:
        raise JointIdError(f"no fit calls {', '.join(gone)} any more: correct PARTS in {__file__}")
    parts = {part: times[function] / total for part, function in PARTS.items()}
    return {**parts, "the rest, NumPy on small matrices": 1.0 - sum(parts.values())}


def shares_table(found: Mapping[str, float]) -> str:
    """A row for each part."""
    return "\n".join(["where the time of these fits goes", *(f"{k:<43}{v:>5.0%}" for k, v in found.items())]) + "\n"


def table(rows: Sequence[FitTimes]) -> str:
    """A row for each choice of labels: medians over the motions, and the worst."""
    lines = [
        f"complete fit of Model 2, 1000 samples, 9 parameters, starts off by up to {FACTOR:g}; processor time",
        f"{'labels':<31}{'converged':>10}{'iterations':>11}{'steps':>7}{'fit':>10}{'wall':>10}{'C++':>10}"
        f"{'fit/C++':>9}{'worst':>7}   target {TARGET:g}",
    ]
    for name in dict.fromkeys(row.labels for row in rows):
        here = [row for row in rows if row.labels == name]
        cpp, took = Times.median(row.cpp for row in here), Times.median(row.fit for row in here)
        ratios = [row.ratio for row in here]
        converged = f"{sum(row.status == 'converged' for row in here)} of {len(here)}"
        lines.append(
            f"{name:<31}{converged:>10}{np.median([r.iterations for r in here]):>11.0f}"
            f"{np.median([r.steps for r in here]):>7.2f}{1e3 * took.cpu_s:>7.1f} ms{1e3 * took.wall_s:>7.1f} ms"
            f"{1e3 * cpp.cpu_s:>7.3f} ms{np.median(ratios):>9.1f}{max(ratios):>7.1f}"
            f"   {'met' if np.median(ratios) <= TARGET else 'missed'}"
        )
    return "\n".join(lines) + "\n"
