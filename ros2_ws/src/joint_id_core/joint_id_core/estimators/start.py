"""What the estimator knows before the fit: the start state, its spread, and rough noise levels."""

from __future__ import annotations

import numpy as np

from joint_id_core.problem import Problem
from joint_id_core.recording import Array

TWIST_SPREAD = 0.02  # rad: more than any harmonic drive twists, seen at the link
TWIST_RATE_SPREAD = 0.5  # rad/s
_PARTNER = {
    "motor_position": ("link_position", TWIST_SPREAD),
    "motor_velocity": ("link_velocity", TWIST_RATE_SPREAD),
}


def start_state(problem: Problem, at: int = 0) -> tuple[Array, Array]:
    """Prior of the state at sample `at`, before its labels: mean (n,) and standard deviation (n,).

    A measured state starts at its first label with a spread far above the label's own range, so that the
    label is not counted twice. An unmeasured one starts from the other side of the gear, with the spread of
    the twist, a velocity from the slope of its own position, or at zero with the spread that its signal is
    known for.
    """
    model, recording = problem.model, problem.recording
    ratio = problem.p[model.parameter_names.index("N")] if "N" in model.parameter_names else 1.0
    first = {}
    for k, name in enumerate(problem.labels):
        seen = np.flatnonzero(np.isfinite(problem.y[:, k]))
        nearest = seen[min(int(np.searchsorted(seen, at)), len(seen) - 1)]
        first[name] = (float(problem.y[nearest, k]), 10.0 * float(np.ptp(problem.y[seen, k])) + 1e-9)
    known = dict(first)
    for k, name in enumerate(model.input_names):
        known.setdefault(name, (float(problem.u[at, k]), 0.0))
    mean, spread = [], []
    for signal in model.states:
        name = signal.name
        if name in first:
            value, sd = first[name]
        elif name in _PARTNER and _PARTNER[name][0] in known:
            partner, sd = _PARTNER[name]
            value, sd = ratio * known[partner][0], ratio * sd
        elif name.startswith("link_") and f"motor_{name[5:]}" in known:
            sd = dict(_PARTNER.values()).get(name, signal.scale)
            value = known[f"motor_{name[5:]}"][0] / ratio
        elif name.endswith("velocity") and name.replace("velocity", "position") in first:
            # Around a wrong velocity Coulomb friction is linearised wrongly, and the first labels then look impossible.
            value, sd = _slope(problem, name.replace("velocity", "position"), at), signal.scale
        elif name in recording and np.isfinite(recording[name]).any():
            finite = np.isfinite(recording[name])
            nearest = np.argmin(np.abs(recording.time[finite] - problem.time[at]))
            value, sd = float(recording[name][finite][nearest]), signal.scale
        else:
            value, sd = 0.0, signal.scale
        mean.append(value)
        spread.append(sd)
    return np.array(mean), np.array(spread)


def _slope(problem: Problem, name: str, at: int) -> float:
    """Slope of the straight line through eight labels of a position from sample `at` on, in its unit a second."""
    values = problem.y[:, problem.labels.index(name)]
    seen = np.flatnonzero(np.isfinite(values[at:]))[:8] + at
    return float(np.polyfit(problem.time[seen] - problem.time[seen[0]], values[seen], 1)[0]) if len(seen) > 1 else 0.0


def label_noise(problem: Problem) -> Array:
    """Rough variance of each label's noise, shape (labels,), from its third differences.

    A smooth motion all but vanishes in them, white noise comes out times sqrt(20); the median keeps events
    such as a reversal of friction out. Never below a floor set by the resolution of the label.
    """
    levels = []
    for column in problem.y.T:
        values = column[np.isfinite(column)]
        third = np.abs(np.diff(values, n=3))
        sd = float(np.median(third)) / 0.6745 / np.sqrt(20.0) if third.size else 0.0
        levels.append(max(sd, np.sqrt(label_floor(values))) ** 2)
    return np.array(levels)


def noise_ceiling(values: Array) -> float:
    """Largest credible noise variance of a measured motion: twice the rms of its third differences allows.

    Noise cannot be larger than what the signal itself shows. Without this bound a wrong model can explain
    itself by a sensor that is far worse than it is.
    """
    finite = values[np.isfinite(values)]
    third = np.diff(finite, n=3)
    level = float(np.mean(third**2)) / 20.0 if third.size else 0.0
    return max(4.0 * level, 4.0 * label_floor(finite))


def label_floor(values: Array) -> float:
    """Smallest credible noise variance of a label: quantisation if it shows, else 1e-7 of its range squared."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    span = float(np.ptp(values)) if values.size else 1.0
    floor = (1e-7 * span) ** 2 + 1e-24
    if steps.size and np.count_nonzero(np.diff(values) == 0) > 0.05 * values.size:
        floor = max(floor, float(np.min(steps)) ** 2 / 12.0 * 0.1)
    return floor


def input_noise(problem: Problem) -> Array:
    """Rough variance of each input's noise per sample, shape (inputs,): 2 % of its rms, of its typical size if zero."""
    rms = np.sqrt(np.mean(np.square(problem.u), axis=0))
    typical = np.array([1e-3 * s.scale for s in problem.model.inputs])
    return np.square(np.maximum(0.02 * rms, typical))
