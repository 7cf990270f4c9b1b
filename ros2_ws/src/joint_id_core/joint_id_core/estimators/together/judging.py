"""What several recordings together say of each parameter, and whether they agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.quantities import with_deviation
from joint_id_core.estimators.shared.intervals import interval_text
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.together.information import FAR, Space
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import MAGNITUDE, NOT_EXCITED_RATIO, PRIOR_RATIO, Verdict


def common(
    space: Space, rows: Sequence[ParameterEstimate], k: int, value: float, std_dev: float, sigma: float
) -> ParameterEstimate:
    """Return common parameter number k from its `rows` in every recording.

    Args:
        space: coordinates of the common parameters.
        rows: of the parameter in each recording.
        k: its number.
        value, std_dev: of all recordings, SI units.
        sigma: standard deviation of its coordinate; inf if no recording knows it.
    """
    if not np.isfinite(sigma):
        below = next((row for row in rows if row.verdict is Verdict.AT_BOUND), None)
        return below or replace(rows[0], std_dev=float("nan"), verdict=Verdict.NOT_EXCITED)
    share = sigma / float(space.spread[k])
    relative = sigma if space.log[k] or not space.positive[k] else sigma / value if value else np.inf
    relative = relative if space.positive[k] else 0.0
    if share > NOT_EXCITED_RATIO:
        verdict, reason = Verdict.NOT_EXCITED, "no recording shows it"
    elif share > PRIOR_RATIO or relative > MAGNITUDE:
        verdict, reason = Verdict.PRIOR, "all recordings together tell its order of magnitude at best"
    else:
        verdict, reason = (
            Verdict.ESTIMATED,
            interval_text(value, std_dev),
        )
    return replace(rows[0], value=value, std_dev=std_dev, verdict=verdict, reason=reason)


def own(model: Model, rows: Sequence[ParameterEstimate]) -> ParameterEstimate:
    """Return a parameter of which every recording has its own: their mean, and how far one may be from it.

    One that is held stays.
    """
    row = rows[0]
    if row.verdict is Verdict.FIXED or not model.parameter(row.name).of_recording:
        return row
    values = [r.value for r in rows]
    said = ", ".join(with_deviation(r.value, r.std_dev) for r in rows)
    scatter = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    sigma = float(np.sqrt(scatter**2 + np.mean([r.std_dev**2 for r in rows])))
    return replace(row, value=float(np.mean(values)), std_dev=sigma, reason=f"one a recording: {said}")


def judge(
    alone: Sequence[Estimate],
    used: Sequence[int],
    found: Mapping[str, ParameterEstimate],
    apart: Sequence[Mapping[str, float]],
) -> tuple[Status, tuple[str, ...]]:
    """Return the status, and the findings as sentences, the most useful first.

    Args:
        alone: the estimate of each recording by itself.
        used: numbers of those that could be used.
        found: the common parameters.
        apart: distance of every recording from all, in standard deviations, by parameter.
    """
    far = [n for n in found if any(abs(apart[k].get(n, 0.0)) > FAR for k in used)]
    doubtful = next((alone[k] for k in used if alone[k].status is Status.DISAGREE), None)
    if far:
        cause = (
            "the joint, its load or its temperature changed, or the model does not describe all of them: the intervals "
            "contain what each says"
        )
        ranges = "; ".join(_range(name, [alone[k] for k in used if name in apart[k]]) for name in far)
        status, said = Status.DISAGREE, [f"the recordings disagree: {ranges}", cause]
    elif doubtful is not None:
        status, said = Status.DISAGREE, [f"recording {doubtful.source}: {doubtful.message}"]
    elif not any(row.verdict is Verdict.ESTIMATED for row in found.values()):
        status, said = Status.UNINFORMATIVE, [Status.UNINFORMATIVE.advice]
    else:
        status, said = (
            Status.CONVERGED,
            [
                Status.CONVERGED.advice,
                f"{len(used)} recordings agree within their intervals"
                if len(used) > 1
                else "Only one recording can be used",
            ],
        )
    for k, estimate in enumerate(alone):
        if k not in used:
            why = estimate.message.removeprefix(f"{estimate.source}: ").split(". ")[0].rstrip(".")
            said.append(f"left out: {estimate.source} ({estimate.status.value}: {why})")
    unknown = (Verdict.NOT_EXCITED, Verdict.PRIOR)
    unseen = [n for n, row in found.items() if row.verdict in unknown and n not in far]
    if unseen and status is not Status.UNINFORMATIVE:
        said.append(f"no recording shows {listed(unseen)}")
    return status, tuple(sentence(text) for text in said)


def _range(name: str, estimates: Sequence[Estimate]) -> str:
    """Return the lowest and the highest value of a parameter, and where they were found."""
    ordered = sorted(estimates, key=lambda e: e[name].value)
    ends = (f"{with_deviation(e[name].value, e[name].std_dev)} ({e.source})" for e in (ordered[0], ordered[-1]))
    return f"{name} is {' to '.join(ends)}"
