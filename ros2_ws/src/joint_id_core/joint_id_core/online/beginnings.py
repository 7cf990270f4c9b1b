"""Where the filter begins, and the state there, by the labels alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import SETTLE_S, FitData
from joint_id_core.estimators.shared.initial_state import rough_states, start_state
from joint_id_core.online.piece import Piece, Samples, State

LEAST = 10  # samples of the shortest motion that is used
SLOW = 0.1  # share of the largest speed of a stretch below which the joint may be near a reversal
SAME = 1e-9  # relative difference of two speeds that rounding can make
TINY = 1e-300


def at_labels(data: FitData, p: Array, rows: slice, sensitive: int) -> tuple[State, Samples]:
    """Return the state at the first of some samples, and the others, in which the filter settles.

    Args:
        data, p: the samples, and all parameters of the model, shape (P,).
        rows: of the samples.
        sensitive: number of parameters by which the state has derivatives; these are zero.
    """
    mean, spread = start_state(data, rows.start, p)
    kept = np.zeros((len(mean), 1 + len(mean) + sensitive))
    kept[:, 0] = mean
    kept[:, 1 : 1 + len(mean)] = np.diag(spread**2)
    state = State(kept, float(data.time[rows.start]), np.ascontiguousarray(data.u[rows.start]))
    later = slice(rows.start + 1, rows.stop)
    return state, Samples(data.time[later], data.u[later], data.y[later])


def first_in_motion(data: FitData, settle: int) -> int:
    """Return the first sample after which a joint moves for `settle` samples, in the first half of a stretch.

    If there is none, it is the one after which it moves fastest. Near a reversal, friction that is smooth while the
    filter settles would leave the state far off.
    """
    model = data.model
    sliding = [k for k, name in enumerate(model.state_names) if name in model.smoothing]
    if not sliding:
        return 0
    speed = np.nan_to_num(np.abs(rough_states(data)[:, sliding]))
    speed = (speed / np.maximum(speed.max(axis=0), TINY)).min(axis=1)
    slowest = np.lib.stride_tricks.sliding_window_view(speed, settle + 1).min(axis=1)
    slowest = slowest[: max(1, len(speed) // 2 - settle)]
    return int(np.argmax(slowest > min(SLOW, float(slowest.max()) * (1.0 - SAME))))


def begun_anew(data: FitData, p: Array, piece: Piece, sensitive: int) -> Piece | None:
    """Return a stretch that begins at its labels, where the joint moves; None if it is too short.

    `data`, `p` and `sensitive` are as in `at_labels`; the samples are those of the stretch.
    """
    samples, settle = piece.samples, round(SETTLE_S / data.period)
    if len(samples.time) - settle <= LEAST:
        return None
    recording = data.recording.trusted(samples.time, {}, frozenset())
    data = replace(data, time=samples.time, u=samples.u, y=samples.y, recording=recording)
    begin = first_in_motion(data, settle)
    settled = begin + 1 + settle
    start = at_labels(data, p, slice(begin, settled), sensitive)
    return replace(piece, begin=replace(start[0], start=start), samples=samples.split(settled)[1])
