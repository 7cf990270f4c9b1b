"""Annealing: fit from start values that may be far from the truth.

The fit starts with strong feedback of the labels, where the cost has few local minima (see docs/theory.md), and reduces
the feedback until it is optimal. It can do most of this on an excerpt of the record.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.stages import Stages
from joint_id_core.estimators.shared.initial_state import busiest

STRONGEST, STRONG = 1e6, 1e4  # first variance of input noise over its rough level; large values: strong label feedback
FEEDBACK = (STRONGEST, STRONG, 1.0)  # tried in this order: a stiff joint may diverge with the strongest feedback
EXCERPT, SHORTEST = 4, 250  # length of a record over the length of its excerpt; shortest excerpt in samples


def annealed(stages: Stages, z: Array, whole: bool = True, tolerance: float | None = None) -> Minimum | None:
    """Fit from z with rough noise levels and the first step size; return None if no pass gives a finite cost.

    Parameters and noise levels are fitted together: the feedback weakens by itself while the parameters improve. With
    unmeasured states this needs parameters that are roughly right, so the parameters are fitted alone before.

    Args:
        stages: the stages to fit with.
        z: start coordinates, shape (k,).
        whole: False fits an excerpt of the record first, if it is long enough.
        tolerance: of the last stage; None takes `stages.tolerance`.
    """
    data, states = stages.data, stages.rough_states
    measured = len(data.labels) == len(data.model.states)
    if not whole and (near := _on_excerpt(stages, z)) is not None:
        # an unmeasured velocity shows the reversals of friction, where more steps are needed, only after a pass
        first = None if measured else stages.started(near.z, near.levels, states, even=True)
        states = states if first is None else first.last.states
        return stages.parameters_and_noise(stages.started(near.z, near.levels, states), tolerance)
    rough = stages.noise.rough
    inputs = np.arange(len(rough)) >= len(data.labels)
    if not measured:
        tries = (stages.started(z, np.where(inputs, by * rough, rough), states, even=True) for by in FEEDBACK)
        near = stages.parameters(next((s for s in tries if s is not None), None))
        if near is None:
            return None
        z, states = near.z, near.last.states
    levels = stages.noise.clip(np.where(inputs, STRONG * rough, rough))
    return stages.parameters_and_noise(stages.started(z, levels, states), tolerance)


def direct(stages: Stages, z: Array, feedback: float, tolerance: float | None = None) -> Minimum | None:
    """Fit parameters and noise levels from z at once; return None if no pass gives a finite cost.

    Args:
        stages: the stages to fit with.
        z: start coordinates, shape (k,), near the truth.
        feedback: first variance of input noise over its rough level.
        tolerance: as in `annealed`.
    """
    rough = stages.noise.rough
    levels = stages.noise.clip(np.where(np.arange(len(rough)) >= len(stages.data.labels), feedback * rough, rough))
    first = stages.started(z, levels, stages.rough_states, even=True)
    start = None if first is None else stages.started(z, levels, first.last.states)
    return stages.parameters_and_noise(start, tolerance)


def _on_excerpt(stages: Stages, z: Array) -> Minimum | None:
    """Fit the part of the record with the most motion; return None if it is too short or its fit does not converge.

    This fit starts on an excerpt itself. Far from the solution, a part of the record is as useful as all of it.
    """
    length = len(stages.data.time) // EXCERPT
    if length < SHORTEST:
        return None
    excerpt = stages.of_part(busiest(stages.data, length), length)
    if excerpt is None:
        return None
    found = annealed(excerpt, z, whole=False)
    stages.effort.iterations += excerpt.effort.iterations
    stages.effort.spent += excerpt.effort.spent
    return found if found is not None and found.settled else None
