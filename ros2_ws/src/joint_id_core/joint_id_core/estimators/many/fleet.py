"""The fits of a whole fleet at once: many joints of one model, each from several starts, in one batch."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.annealing import STRONG
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import estimate_of
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.search import Search
from joint_id_core.estimators.innovations.stages import TOLERANCE
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import passes_on, require_device
from joint_id_core.estimators.many.starts import drawn
from joint_id_core.estimators.regression_starts import started
from joint_id_core.estimators.shared.fit_data import UnusableError, prepare, unusable
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate, Status

DEFAULTS = Innovations()


def fit_fleet(
    model: Model,
    recordings: Sequence[Recording],
    settings: ParameterSettings | None = None,
    starts: int = 4,
    device: str = "cpu",
    seed: int = 0,
    estimator: Innovations = DEFAULTS,
    progress: Progress | None = None,
) -> list[Estimate]:
    """Fit recordings of many joints, one estimate each, with the searches of all of them in one batch.

    The first start of a joint is the prior mean, the others are drawn from the prior. The number of integrator steps is
    settled afterwards, joint by joint, as in `Innovations.fit`; so are the checks.

    Args:
        model, settings: as in `fit`, the same for all.
        recordings: one for each joint.
        starts: of each joint.
        device: "cpu", "cuda" (torch on a GPU) or "torch" (torch on the CPU): the same results.
        seed: of the draws.
        estimator: options of the engine.
        progress: called with a line of text from time to time.

    Returns:
        The estimates in the order of the recordings. Poor data raise no exception: the status says what is wrong.

    Raises:
        JointIdError: no recording, misuse of names or values, a device that is not there.
    """
    if not recordings or starts < 1:
        raise JointIdError(f"{len(recordings)} recordings and {starts} starts: give one of each, or more")
    require_device(device, estimator.cell)
    tell, begun = progress or (lambda _: None), time.perf_counter()
    estimates: dict[int, Estimate] = {}
    groups: dict[tuple[str, ...], list[tuple[int, Search, Minimum, list[Start]]]] = {}
    for i, recording in enumerate(recordings):
        tell(f"reading recording {i + 1} of {len(recordings)}")
        try:
            data = prepare(model, recording, started(model, recording, settings), leave_out_rests=True)
        except UnusableError as error:
            estimates[i] = unusable(model, estimator.name, error, recording, settings)
            continue
        search = Search(data, compile_model(model, "tanh", data.freed, estimator.cell), estimator, None, tell)
        stages = search.stages
        rough, inputs = stages.noise.rough, np.arange(len(stages.noise.rough)) >= len(data.labels)
        points = [(stages.cost.belief.mean, stages.noise.clip(np.where(inputs, STRONG * rough, rough)))]
        points += drawn(stages, starts - 1, seed)
        first = next((s for z, levels in points if (s := stages.started(z, levels, stages.rough_states))), None)
        if first is None:
            estimates[i] = _diverged(model, recording, estimator, settings)
            continue
        group = groups.setdefault(data.labels, [])
        jobs = [Start(len(group), stages.cost, stages.scoring, z, levels) for z, levels in points]
        group.append((i, search, first, jobs))
    for group in groups.values():
        recursions = [search.stages.recursion for _, search, _, _ in group]
        passes = passes_on(device, recursions, [first.last.steps for _, _, first, _ in group])
        every = [job for *_, jobs in group for job in jobs]
        ends = minimised(
            passes, every, [first.substeps for _, _, first, _ in group], TOLERANCE, estimator.max_iterations, tell
        )
        for n, (i, search, _, jobs) in enumerate(group):
            own = [end for end in ends[n * starts : (n + 1) * starts] if end is not None]
            outcome = search.concluded([end for e in own if (end := _whole(search, e)) is not None], len(jobs))
            if outcome is None or not outcome.minimum.definite:
                estimates[i] = _diverged(model, recordings[i], estimator, settings)
            else:
                estimates[i] = estimate_of(outcome, begun)
    return [estimates[i] for i in range(len(recordings))]


def _whole(search: Search, end: Minimum) -> Minimum | None:
    """Return an end with the path of its pass, which the batch did not keep."""
    found = search.stages.cost.at(end.z, end.levels, end.last.steps, end.substeps)
    if found is None:
        return None
    return replace(found, settled=end.settled, iterations=end.iterations, left=end.left)


def _diverged(
    model: Model, recording: Recording, estimator: Innovations, settings: ParameterSettings | None
) -> Estimate:
    error = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice}")
    return unusable(model, estimator.name, error, recording, settings)
