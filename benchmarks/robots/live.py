"""Recordings of real robots, sample by sample, as the identifier gets them while a robot works.

Nobody knows the truth of a real joint. An estimate is compared with the reference of its case where that has a spread,
else with the fit of the whole recording.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core import estimators
from joint_id_core.data.recording import Recording
from joint_id_core.filtering.offline import complete
from joint_id_core.models import Model, build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.results.estimate import Estimate, Status, Verdict
from robots.cases import CASES, Case, Joint, Known
from robots.fitted import FRICTION, OF_THE_DATA, Value
from robots.judging import INTERVAL, deviation
from robots.methods import SHOWN
from robots.pages import table

BATCH_S = 0.05  # of samples that come together
FAR = 4.0  # standard deviations from which an estimate is wrong


@dataclass(frozen=True)
class Live:
    """A recording that was followed.

    Attributes:
        case, joint, recording: which one.
        moved, known, good: number of estimates in motion, of these with known friction, and of status converged.
        wrong: of the good ones, with a parameter that is far off.
        longest_s: longest stretch of wrong ones in s.
        compared, inside, far: values of known friction with a reference, those whose 95 % interval contains it, and
            those that are far off.
        told: instants at which a change of the joint was told; nobody knows of one.
        sigma: median standard deviation over the value, of known friction; NaN if there is none.
        share: processor time over the time of the recording.
    """

    case: str
    joint: str
    recording: str
    moved: int
    known: int
    good: int
    wrong: int
    longest_s: float
    compared: int
    inside: int
    far: int
    told: int
    sigma: float
    share: float


def followed(names: Sequence[str] | None = None) -> Iterator[Live]:
    """Follow the recordings whose data are there; `names`: only cases with one of these texts."""
    for case in CASES:
        if case.there and (not names or any(text in case.name for text in names)):
            for joint in case.joints:
                for recording in joint.fitted():
                    yield follow(case, joint, recording)


def follow(case: Case, joint: Joint, recording: Recording) -> Live:
    """Follow a recording of a joint."""
    model = build("rigid_joint", gravity=joint.gravity)
    reference = _reference(joint, estimators.fit(model, recording))
    found, share = _estimates(model, complete(recording))
    moved = [e for e in found if e.status not in (Status.NO_MOTION, Status.TOO_SHORT)]
    known = [e for e in moved if e.status.value in OF_THE_DATA and set(FRICTION) <= _estimated(e)]
    friction = [e[n] for e in known for n in FRICTION]
    off = [deviation(Value(p.value, p.std_dev), reference[p.name]) for p in friction if p.name in reference]
    wrong = [e.converged and _farthest(e, reference) > FAR for e in moved]
    return Live(
        case.name, joint.name, recording.source, len(moved), len(known), sum(e.converged for e in moved), sum(wrong),
        longest(wrong, [e.end for e in moved]), len(off), sum(abs(z) < INTERVAL for z in off),
        sum(abs(z) > FAR for z in off), len({c.since for e in moved for c in e.changes if c.sure}),
        float(np.median([p.std_dev / abs(p.value) for p in friction] or [np.nan])), share,
    )  # fmt: skip


def _reference(joint: Joint, whole: Estimate) -> dict[str, Known]:
    """Values of others that have a spread, and else those of a fit of the whole recording, by parameter."""
    usable = whole.status.value in OF_THE_DATA
    fitted = {n: Known(whole[n].value, whole[n].std_dev) for n in SHOWN if usable and n in _estimated(whole)}
    return fitted | {n: known for n, known in joint.known.items() if known.spread > 0.0}


def _estimates(model: Model, recording: Recording) -> tuple[list[Estimate], float]:
    """All estimates of an identifier, and its share of a processor."""
    identifier, found, begun = OnlineIdentifier(model), list[Estimate](), time.process_time()
    step = max(1, round(BATCH_S / recording.period))
    for k in range(0, len(recording), step):
        estimate = identifier.update(recording.slice(k, min(k + step, len(recording))))
        if estimate is not None:
            found.append(estimate)
    return found, (time.process_time() - begun) / recording.duration


def _estimated(estimate: Estimate) -> set[str]:
    return {n for n in SHOWN if estimate[n].verdict is Verdict.ESTIMATED}


def _farthest(estimate: Estimate, reference: dict[str, Known]) -> float:
    """Largest difference of a parameter from its reference, in combined standard deviations."""
    rows = [estimate[n] for n in _estimated(estimate) & set(reference)]
    return max((abs(deviation(Value(p.value, p.std_dev), reference[p.name])) for p in rows), default=0.0)


def longest(wrong: Sequence[bool], ends: Sequence[float]) -> float:
    """Longest stretch of wrong estimates in s; one lasts until the next estimate."""
    found, begin = 0.0, None
    for is_wrong, end in zip([*wrong, False], [*ends, ends[-1]] if ends else [0.0], strict=True):
        if is_wrong and begin is None:
            begin = end
        if not is_wrong and begin is not None:
            found, begin = max(found, end - begin), None
    return found


def live_table(rows: Sequence[Live]) -> str:
    """A row for each case, and one for all."""
    head = ["recordings", "logs", "estimates in motion", "friction known", "`converged`", "of these wrong", "longest",
            "friction within 95 %", "far off", "changes told", "median sigma", "of a core"]  # fmt: skip
    names = [case.name for case in CASES if any(r.case == case.name for r in rows)]
    some = [(name, [r for r in rows if r.case == name]) for name in names]
    return table(head, [_cells(name, of) for name, of in [*some, ("**all**", rows)] if of])


def _cells(name: str, rows: Sequence[Live]) -> list[str]:
    moved, known, good, wrong, compared, inside, far = (
        sum(getattr(r, part) for r in rows) for part in ("moved", "known", "good", "wrong", "compared", "inside", "far")
    )
    sigma, share = np.nanmedian([r.sigma for r in rows]), np.mean([r.share for r in rows])
    return [
        name, str(len(rows)), str(moved), _percent(known, moved), _percent(good, moved), _percent(wrong, good),
        f"{max(r.longest_s for r in rows):.1f} s", _percent(inside, compared), _percent(far, compared),
        str(sum(r.told for r in rows)),
        f"{100.0 * sigma:.2g} %", f"{100.0 * share:.0f} %",
    ]  # fmt: skip


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.0f} %" if whole else "-"
