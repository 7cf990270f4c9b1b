"""A record filtered with what an estimate knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.substeps import MOST_TURNING, steps_of, steps_to_stand


def filtered(
    data: FitData, kernel: Kernel, noise: Mapping[str, float], substeps: int, others: Sequence[Array] = ()
) -> list[Pass]:
    """Filter the states of a record with the start values of `data`; then so with each of `others` as inputs.

    Args:
        data: the record; its start values are the parameters to use.
        kernel: the compiled cell of its model.
        noise: standard deviations as in `Estimate.noise`; missing or zero ones are estimated roughly from the record.
        substeps: as in `Estimate.substeps`.
        others: inputs, each of shape (T, inputs).
    """
    recursion, first = run_through(data, kernel, noise, substeps)
    rest = (recursion.with_inputs(inputs).run(first.free, first.levels, first.steps) for inputs in others)
    return [first, *rest]


def run_through(
    data: FitData, kernel: Kernel, noise: Mapping[str, float], substeps: int
) -> tuple[Recursion, Pass]:  # fmt: skip
    """Filter the states of a record with the start values of `data`; return the recursion as well.

    Where a state that is not measured stands still is known roughly only. With too few integrator steps there the path
    diverges; then all samples take as many as a joint at standstill needs.

    Args: as of `filtered`.
    """
    rough, recursion = NoiseLevels.of(data).rough, Recursion(data, kernel)
    levels = np.array(
        [v if not noise.get(n, 0.0) > 0.0 else noise[n] ** 2 for n, v in zip(data.noise_names, rough, strict=True)]
    )
    substeps, near, free = max(1, substeps), rough_states(data), data.p[recursion.index]
    steps = steps_of(data, kernel, data.p, near, substeps)
    found = recursion.run(free, levels, steps)
    if not np.isfinite(found.cost):
        many = steps_to_stand(data, kernel, data.p, near, substeps, MOST_TURNING)
        found = recursion.run(free, levels, np.maximum(steps, many))
    return recursion, found
