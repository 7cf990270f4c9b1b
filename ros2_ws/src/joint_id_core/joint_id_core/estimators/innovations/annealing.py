"""The way from a start that may be far off: feedback of the labels from strong to optimal, first on an excerpt.

With strong feedback the cost has few local minima (see docs/theory.md).
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.stages import Stages
from joint_id_core.estimators.shared.initial_state import busiest

STRONGEST, STRONG = 1e6, 1e4  # first input noise over its rough level: the feedback of the previous labels
FEEDBACK = (STRONGEST, STRONG, 1.0)  # tried in turn: a stiff joint may not stand the strongest
EXCERPT, SHORTEST = 4, 250  # length of a record over that of its excerpt, and the shortest excerpt in samples


def annealed(stages: Stages, z: Array, whole: bool = True, tolerance: float | None = None) -> Minimum | None:
    """One fit from z with rough noise levels and the first step size; None where it leads nowhere.

    Where every state is measured the noise levels, fitted along, weaken the feedback by themselves as fast as the
    parameters come closer; unmeasured states need parameters that are not far off before that. With `whole` false
    the first part of the way is gone on an excerpt of the record. `tolerance` is that of the last stage.
    """
    data, rough, states = stages.data, stages.noise.rough, stages.rough_states
    inputs = np.arange(len(rough)) >= len(data.labels)
    if len(data.labels) < len(data.model.states):
        tries = (stages.started(z, np.where(inputs, by * rough, rough), states, even=True) for by in FEEDBACK)
        near = stages.parameters(next((s for s in tries if s is not None), None))
        if near is None:
            return None
        z, states = near.z, near.last.states
    elif not whole and (near := _on_excerpt(stages, z)) is not None:
        return stages.parameters_and_noise(stages.started(near.z, near.levels, states), tolerance)
    levels = stages.noise.clip(np.where(inputs, STRONG * rough, rough))
    return stages.parameters_and_noise(stages.started(z, levels, states), tolerance)


def _on_excerpt(stages: Stages, z: Array) -> Minimum | None:
    """A fit of the part of the record where most happens, itself begun on an excerpt; None where it is too short.

    Far from the solution a part of the record shows the way as well as all of it.
    """
    length = len(stages.data.time) // EXCERPT
    if length < SHORTEST:
        return None
    excerpt = stages.of_part(busiest(stages.data, length), length)
    if excerpt is None:
        return None
    found = annealed(excerpt, z, whole=False)
    stages.effort.iterations += excerpt.effort.iterations
    return found if found is not None and found.settled else None
