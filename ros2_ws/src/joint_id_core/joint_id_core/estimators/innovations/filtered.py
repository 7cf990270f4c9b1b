"""A record filtered with what an estimate knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.substeps import steps_of


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
    levels, steps = levels_and_steps(data, kernel, noise, substeps)
    recursion = Recursion(data, kernel)
    passes = (recursion, *map(recursion.with_inputs, others))
    return [one.run(data.p[recursion.index], levels, steps) for one in passes]


def levels_and_steps(data: FitData, kernel: Kernel, noise: Mapping[str, float], substeps: int) -> tuple[Array, Steps]:
    """Return noise variances, shape (labels + inputs,), and integrator steps of a pass; arguments as of `filtered`."""
    rough = NoiseLevels.of(data).rough
    levels = np.array(
        [v if not noise.get(n, 0.0) > 0.0 else noise[n] ** 2 for n, v in zip(data.noise_names, rough, strict=True)]
    )
    return levels, steps_of(data, kernel, data.p, rough_states(data), max(1, substeps))
