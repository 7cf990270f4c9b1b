"""Many starts: is the minimum that a fit found the best one?

The cost of a fit has several minima where states are not measured, or where the motion tells little. The engine tries a
few starts. This module tries thousands, drawn from the prior, and counts where they end (multistart, the plainest of
the methods of global optimisation: Rinnooy Kan and Timmer, Mathematical Programming 39, 1987).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.annealing import STRONG
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.search import APART, SAME_COST, Outcome
from joint_id_core.estimators.innovations.stages import STALLED, TOLERANCE, Stages
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import passes_on, require_device
from joint_id_core.estimators.many.problem import physical, searched
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress

DEFAULTS = Innovations()
SHOWN = 5  # minima in the printed table


@dataclass(frozen=True)
class End:
    """A minimum where starts ended.

    Attributes:
        cost: above that of the lowest one; twice the difference of the log likelihood, prior included.
        share: of all starts that ended here.
        away: distance from the engine's minimum in standard deviations of the engine's.
        values, std_dev: of the free parameters, by name, SI units.
    """

    cost: float
    share: float
    away: float
    values: dict[str, float]
    std_dev: dict[str, float]


@dataclass(frozen=True)
class ManyStarts:
    """Where many starts ended.

    Attributes:
        source: the recording.
        starts: number of starts.
        ends: the minima, the lowest first.
        diverged: starts without a finite cost.
        unsettled: starts whose iteration did not end at a minimum.
        gain: by how much the lowest cost of any start is below that of the engine's minimum; 0 if none is.
        device: where the passes ran.
        elapsed_s: time in s, without the engine's fit.
    """

    source: str
    starts: int
    ends: tuple[End, ...]
    diverged: int
    unsettled: int
    gain: float
    device: str
    elapsed_s: float

    @property
    def engine_is_best(self) -> bool:
        """Whether no start found a point that is clearly more likely than the engine's."""
        return self.gain < SAME_COST

    def to_dict(self) -> dict[str, object]:
        """Return all of it as JSON-ready values."""
        ends = [
            {"cost": e.cost, "share": e.share, "away": e.away, "values": e.values, "std_dev": e.std_dev}
            for e in self.ends
        ]
        return {
            "source": self.source, "starts": self.starts, "engine_is_best": self.engine_is_best, "gain": self.gain,
            "diverged": self.diverged, "unsettled": self.unsettled, "device": self.device,
            "elapsed_s": self.elapsed_s, "ends": ends,
        }  # fmt: skip

    def __str__(self) -> str:
        found = "no start is better than the fit" if self.engine_is_best else (
            f"a better point than the fit exists: its cost is lower by {self.gain:.3g}"
        )  # fmt: skip
        lines = [f"{self.starts} starts of {self.source}: {found}"]
        if self.diverged or self.unsettled:
            lines.append(f"{self.diverged} diverged, {self.unsettled} ended at no minimum")
        lines.append(f"{'cost above the best':>20} {'of starts':>10} {'from the fit':>13}")
        for end in self.ends[:SHOWN]:
            lines.append(f"{end.cost:20.3g} {end.share:10.1%} {end.away:7.2g} sigma")
        if len(self.ends) > SHOWN:
            lines.append(f"and {len(self.ends) - SHOWN} more")
        return "\n".join(lines)


def many_starts(
    model: Model,
    recording: Recording,
    settings: ParameterSettings | None = None,
    starts: int = 1000,
    device: str = "cpu",
    seed: int = 0,
    estimator: Innovations = DEFAULTS,
    progress: Progress | None = None,
) -> ManyStarts:
    """Fit a recording from many starts, and compare with the minimum of the engine.

    Start values are drawn from the prior of the parameters (their spreads in the model's table, or `settings.priors`),
    start levels of the input noise up to a factor 1e4 above their rough level. All use the engine's integrator steps.

    Args:
        model, recording, settings: as in `fit`.
        starts: how many.
        device: "cpu", "cuda" (torch on a GPU) or "torch" (torch on the CPU): the same results.
        seed: of the draws.
        estimator: options of the engine.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: misuse of names or values, data that cannot be fitted, a device that is not there.
    """
    if starts < 1:
        raise JointIdError(f"starts = {starts}: give 1 or more")
    require_device(device, estimator.cell)
    tell = progress or (lambda _: None)
    outcome = searched(model, recording, settings, estimator, tell)
    engine, stages = outcome.minimum, outcome.stages
    passes = passes_on(device, [stages.recursion], [engine.last.steps])
    begun = time.perf_counter()
    jobs = [Start(0, stages.cost, stages.scoring, engine.z, engine.levels)]
    jobs += [Start(0, stages.cost, stages.scoring, z, levels) for z, levels in drawn(stages, starts, seed)]
    found = minimised(passes, jobs, [engine.substeps], TOLERANCE, estimator.max_iterations, tell)
    return _counted(outcome, found, recording.source, device, time.perf_counter() - begun)


def drawn(stages: Stages, starts: int, seed: int) -> list[tuple[Array, Array]]:
    """Return random start coordinates (k,) and start levels (L,)."""
    rng = np.random.default_rng(seed)
    at, rough = stages.coordinates, stages.noise.rough
    inputs = np.arange(len(rough)) >= len(stages.data.labels)
    found = []
    for _ in range(starts):
        z = at.clip(stages.cost.belief.mean + at.spread * rng.standard_normal(len(at.spread)))
        feedback = STRONG ** rng.uniform()
        found.append((z, stages.noise.clip(np.where(inputs, feedback * rough, rough))))
    return found


def _counted(outcome: Outcome, found: Sequence[Minimum | None], source: str, device: str, elapsed: float) -> ManyStarts:
    """Group the ends; the first search started at the engine's minimum."""
    engine, ends = found[0] or outcome.minimum, [end for end in found[1:] if end is not None]
    lowest = min([engine.cost, *(end.cost for end in ends)])
    groups: list[tuple[Minimum, int]] = []
    for end in sorted(filter(_at_minimum, ends), key=lambda e: e.cost):
        for j, (first, count) in enumerate(groups):
            dz = end.z - first.z
            if dz @ first.hessian @ dz < APART**2:
                groups[j] = (first, count + 1)
                break
        else:
            groups.append((end, 1))
    shown = []
    for first, count in groups:
        dz = first.z - engine.z
        away = float(np.sqrt(dz @ engine.hessian @ dz))
        values, std_dev = physical(outcome, first.z, first.inverse)
        shown.append(End(first.cost - lowest, count / (len(found) - 1), away, values, std_dev))
    return ManyStarts(
        source, len(found) - 1, tuple(shown), len(found) - 1 - len(ends), sum(not _at_minimum(e) for e in ends),
        max(0.0, engine.cost - lowest), device, elapsed,
    )  # fmt: skip


def _at_minimum(end: Minimum) -> bool:
    return end.settled and end.definite and end.distance_left < STALLED
