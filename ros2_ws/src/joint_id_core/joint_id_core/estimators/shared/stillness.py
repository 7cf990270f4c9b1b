"""Samples at which a joint stands still, from its measured signals alone.

A joint that sticks shows nothing of its parameters but a bound of its friction, and smoothed friction lets it creep.
Over some tenths of a second this creep is larger than the noise of an encoder. So samples at rest are left out, and the
filter starts again where motion begins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS, side_of
from joint_id_core.estimators.shared.initial_state import rough_noise

STILL_S = 0.05  # shortest rest that counts: a reversal is shorter
LEAST = 5  # samples of a rest
MOTION = ("_position", "_velocity")  # ends of the names of labels that show motion
CREDIBLE = 0.1  # largest slack over the typical size of the signal; a noisier signal says nothing about rest
BLIND = 3.0  # slack over the range in a moving stretch from which a label cannot tell motion from rest
NOISY = 8.0  # range of a resting signal over the standard deviation of its noise; of 25 normal numbers it is 4
WIND_UP_S = 0.3  # longest time in which a motor winds up the gear before the link moves; a frozen encoder lasts longer
SLOW = 1e-3  # speed of a resting joint over the typical one: creep under load
HELD = 10.0  # range of a link over the largest one of a link at rest up to which it is shaken, but goes nowhere


def still(
    labels: tuple[str, ...], y: Array, period: float, noise: Mapping[str, float] | None = None
) -> NDArray[np.bool_]:
    """Return True for samples that belong to a rest, shape (T,).

    Args:
        labels: names of the labels; those that are neither positions nor velocities say nothing about rest.
        y: their values, shape (T, labels), NaN where missing.
        period: of the samples in s.
        noise: standard deviations by label; None takes them from the samples. A label whose noise hides the motion of
            this record, such as a coarse encoder's, is then left out.
    """
    count = max(LEAST, round(STILL_S / period) + 1)
    if len(y) < count:
        return np.zeros(len(y), dtype=bool)
    shown: list[tuple[str, Array, float]] = []
    for name, values in zip(labels, y.T, strict=True):
        if not name.endswith(MOTION) or (noise is not None and name not in noise):
            continue
        known = np.isfinite(values)
        row = values if known.all() else values[known]
        if len(row) < count:
            continue
        slack, scale = NOISY * noise[name] if noise is not None else _slack(row), CHANNELS[name].scale
        filled = row if len(row) == len(values) else np.interp(np.arange(len(values)), np.flatnonzero(known), row)
        if slack > CREDIBLE * scale:
            continue
        # The first and the last sample of a stretch already tell most motion from rest.
        if (np.abs(filled[count - 1 :] - filled[: 1 - count]) > slack + SLOW * scale).all():
            return np.zeros(len(y), dtype=bool)
        shown.append((name, filled, slack))
    quiet: NDArray[np.bool_] | None = None
    for name, filled, slack in shown:
        size = _ranges(filled, count)
        if noise is None and _hidden(name, filled, size, slack):
            continue
        calm = _calm(name, slack, size, filled, count)
        quiet = calm if quiet is None else quiet & calm
    if quiet is None:
        return np.zeros(len(y), dtype=bool)
    # a sample is at rest if any quiet stretch of `count` samples holds it
    return np.convolve(quiet, np.ones(count, dtype=int))[: len(y)] > 0


def surely_moves(name: str, values: Array, period: float, noise: float) -> bool:
    """Return whether one label with this standard deviation tells that no sample belongs to a rest, as for `still`.

    `values` (T,) may lack some; then the answer is no. Where it is no, `still` tells.
    """
    slack, scale, count = NOISY * noise, CHANNELS[name].scale, max(LEAST, round(STILL_S / period) + 1)
    if not name.endswith(MOTION) or slack > CREDIBLE * scale or len(values) < count:
        return False
    return bool(compile_shared().always_moves(values, count, slack + SLOW * scale))


def sure_speed(name: str, noise: float) -> float:
    """Return the speed above which a single sample of a label with this standard deviation belongs to no rest.

    In a rest, as `still` finds it, neither the mean speed nor the range of speeds is larger than half of that. inf if
    the label does not show speed.
    """
    slack, scale = NOISY * noise, CHANNELS[name].scale
    if not name.endswith("_velocity") or slack > CREDIBLE * scale:
        return math.inf
    return 2.0 * (slack + SLOW * scale)


def sure_distance(name: str, noise: float) -> float:
    """Return the range of positions with this standard deviation above which no rest holds them, as `still` finds it.

    inf if the label shows no position, or a noisy one.
    """
    slack, scale = NOISY * noise, CHANNELS[name].scale
    if not name.endswith("_position") or slack > CREDIBLE * scale:
        return math.inf
    return slack + SLOW * scale * STILL_S


def still_in_record(labels: tuple[str, ...], y: Array, period: float) -> NDArray[np.bool_]:
    """Return `still` of a whole record, which may begin or end within a rest: there, `LEAST` samples are enough."""
    beyond = max(LEAST, round(STILL_S / period) + 1)
    rest = still(labels, np.pad(y, ((beyond, beyond), (0, 0)), constant_values=np.nan), period)[beyond:-beyond]
    for part in (rest, rest[::-1]):
        at_end = len(part) if part.all() else int(np.argmin(part))
        if at_end < LEAST:
            part[:at_end] = False
    return rest


def still_link(
    labels: tuple[str, ...], y: Array, period: float, noise: Mapping[str, float] | None = None
) -> NDArray[np.bool_]:
    """Return True for samples at which the link rests, whatever the motor does; see `still`."""
    link = [k for k, name in enumerate(labels) if side_of(name) == "link"]
    return still(tuple(labels[k] for k in link), y[:, link], period, noise)


def held_still(recording: Recording) -> bool:
    """Return whether the link goes nowhere in a recording: motion of other joints may shake it.

    The twist of its gear is then all that the recording shows, and it shows that of a rest as well.
    """
    found = _ranges_of_link(recording)
    return bool(found) and all(size < HELD * (slack + creep) for size, slack, creep in found)


def goes_nowhere(recording: Recording) -> bool:
    """Return whether the link yields by 0.5 mrad at most, beside the noise of its sensor: too little to slide."""
    found = _ranges_of_link(recording)
    return bool(found) and all(size < slack + HELD * creep for size, slack, creep in found)


def _ranges_of_link(recording: Recording) -> list[tuple[float, float, float]]:
    """Return the range of each measured signal of the link, that of its noise, and of creep in a rest."""
    found = []
    for name in ("link_position", "link_velocity"):
        if recording.measured(name):
            row = recording[name][np.isfinite(recording[name])]
            creep = SLOW * CHANNELS[name].scale * (STILL_S if name.endswith("_position") else 1.0)
            found.append((float(np.ptp(row)), _slack(row), creep))
    return found


def wound_up(
    rest: NDArray[np.bool_], link_still: NDArray[np.bool_], period: float, before: int | None = None
) -> tuple[NDArray[np.bool_], int | None]:
    """Return `rest` (T,) with the samples after it at which the link still sticks, while the motor winds up the gear.

    When the link breaks loose depends on static friction, which is another quantity than the sliding friction of the
    models. The twist at that moment is not known either. So these samples would tell wrong values with confidence.

    Args:
        rest: True where the whole joint rests.
        link_still: True where the link rests.
        period: of the samples in s.
        before: number of samples since the joint rested, if the link has not moved since; else None.

    Returns:
        The samples that tell nothing, and `before` of the samples that follow.
    """
    if before is None and not rest.any():
        return rest, None
    index, far = np.arange(len(rest)), -len(rest) - round(WIND_UP_S / period) - 2
    rested = np.maximum.accumulate(np.where(rest, index, far if before is None else -1 - before))
    moved = np.maximum.accumulate(np.where(rest | link_still, far, index))
    found = (rested > moved) & (index - rested <= round(WIND_UP_S / period))
    return found, int(len(rest) - 1 - rested[-1]) if found[-1] else None


def _ranges(values: Array, count: int) -> Array:
    """Return the range of every stretch of `count` samples of values (T,), shape (T - count + 1,)."""
    inner = slice(count // 2, count // 2 + len(values) - count + 1)
    return np.asarray(maximum_filter1d(values, count)[inner] - minimum_filter1d(values, count)[inner])


def _hidden(name: str, values: Array, size: Array, slack: float) -> bool:
    """Return whether the noise of a label hides the motion of this record, in which the joint moves.

    `size` (T - count + 1,) are the ranges of its stretches. Where few of them are large, the joint may rest for most of
    the time: then those that are not calm are large, and it goes nowhere in those that are.
    """
    if BLIND * slack <= _ninetieth(size):
        return False
    if _calm(name, slack, np.ptp(values, keepdims=True), values, len(values))[0]:
        return False
    count = len(values) - len(size) + 1
    calm = _calm(name, slack, size, values, count)
    if calm.all() or BLIND * slack > _ninetieth(size[~calm]):
        return True
    if name.endswith("_position"):
        return _goes_on(values, calm, BLIND * slack, SLOW * CHANNELS[name].scale * STILL_S / count)
    noise = slack / (NOISY * math.sqrt(count)) + SLOW * CHANNELS[name].scale  # of the mean of a stretch at rest
    return bool(np.sqrt(np.mean(_means(values, count)[calm] ** 2)) > 0.5 * BLIND * noise)


def _goes_on(values: Array, calm: NDArray[np.bool_], far: float, creep: float) -> bool:
    """Return whether values (T,) go further than `far` while one stretch after the other is calm.

    `calm` belongs to the stretches that begin at the first samples; `creep` a sample is no motion.
    """
    edges = np.flatnonzero(np.diff(calm.view(np.int8), prepend=0, append=0))
    lengths = edges[1::2] - edges[::2]
    ranges = np.maximum.reduceat(values, edges)[::2] - np.minimum.reduceat(values, edges)[::2]
    return bool((ranges > far + creep * lengths).any())


def _ninetieth(values: Array) -> float:
    """Return the value that nine of ten values (n,) do not exceed; a partition takes a tenth of `np.quantile`."""
    place = int(0.9 * (len(values) - 1))
    return float(np.partition(values, place)[place])


def seen_by(labels: tuple[str, ...], y: Array, period: float, noise: Mapping[str, float]) -> dict[str, float]:
    """Return those entries of `noise` whose labels show in this record of motion whether the joint rests."""
    count = max(LEAST, round(STILL_S / period) + 1)
    found = {}
    for name, values in zip(labels, y.T, strict=True):
        row = values[np.isfinite(values)]
        if len(row) > count:
            size = np.abs(row[count:] - row[:-count])
            if BLIND * NOISY * noise[name] <= _ninetieth(size):
                found[name] = noise[name]
    return found


def _slack(row: Array) -> float:
    """Return the range of a signal at rest: that of its noise and its resolution."""
    return float(NOISY * np.sqrt(rough_noise(row)) + 2.0 * resolution(row))


def _calm(name: str, slack: float, size: Array, values: Array, count: int) -> NDArray[np.bool_]:
    """Return whether stretches of `count` samples of values (T,), with these ranges, are those of a joint at rest."""
    speed = SLOW * CHANNELS[name].scale
    if name.endswith("_position"):
        return np.asarray(size <= slack + speed * STILL_S)
    mean = _means(values, count)
    return np.asarray((size <= slack + speed) & (np.abs(mean) <= 0.5 * slack / np.sqrt(count) + speed))


def _means(values: Array, count: int) -> Array:
    """Return the mean of every stretch of `count` samples of values (T,), shape (T - count + 1,)."""
    return np.convolve(values, np.full(count, 1.0 / count), "valid")


def resolution(row: Array) -> float:
    """Return the smallest step of a quantised signal; 0 if its values hardly ever repeat."""
    steps = np.abs(row[1:] - row[:-1])
    moved = steps[steps > 0.0]
    return float(moved.min()) if 0 < len(moved) < 0.9 * len(steps) else 0.0
