"""What an identifier says of a record, hop by hop, and how right it is."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.published import DISAGREE
from joint_id_core.results.estimate import Estimate, Status, Verdict
from online.joints import Joint
from online.records import Watched

FORGOTTEN = "The joint has changed: what was known is forgotten."
BATCH = 10  # samples that come at once
FAR = 4.0  # standard deviations from which an estimate is wrong
SINCE_S = 1.0  # how much before the true change an identifier may say that it began


@dataclass(frozen=True)
class Hop:
    """An estimate beside the truth.

    Attributes:
        end: its newest sample in s.
        status: of the estimate.
        rests: whether it says that the joint rests, and the joint does rest.
        forgot: whether it says that all that was known is forgotten.
        named: instants since which parameters have changed, as the estimate says, in s.
        found: what the checks of residuals and predictions say.
        off: error over its standard deviation, by parameter with the verdict `estimated`; empty unless converged.
    """

    end: float
    status: str
    rests: bool
    forgot: bool
    named: tuple[float, ...]
    found: tuple[str, ...]
    off: Mapping[str, float]

    @property
    def converged(self) -> bool:
        """Whether the estimate says so."""
        return self.status == Status.CONVERGED.value

    @property
    def worst(self) -> str:
        """Parameter with the largest error over its standard deviation; empty if none is estimated."""
        return max(self.off, key=lambda n: abs(self.off[n]), default="")

    @property
    def largest(self) -> float:
        """That error."""
        return abs(self.off[self.worst]) if self.off else 0.0


def watch(joint: Joint, watched: Watched, until: float = np.inf) -> Iterator[Hop]:
    """Estimates of a record, up to an instant in s."""
    identifier = OnlineIdentifier(joint.model, joint.settings, OnlineOptions())
    recording = watched.recording
    for k in range(0, len(recording), BATCH):
        estimate = identifier.update(recording.slice(k, k + BATCH))
        if estimate is not None:
            yield of(estimate, watched.truth(estimate.end), watched.moves(estimate.end))
            if estimate.end > until:
                return


def of(estimate: Estimate, truth: Mapping[str, float], moves: bool) -> Hop:
    """An estimate beside the truth; `moves` says whether the joint moved a moment ago."""
    rests = estimate.status is Status.NO_MOTION and DISAGREE not in estimate.notes and not moves
    rows = [p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED] if estimate.converged else []
    return Hop(
        estimate.end, estimate.status.value, rests, FORGOTTEN in estimate.notes,
        tuple(c.since for c in estimate.changes),
        estimate.checks.texts if estimate.checks is not None else (),
        {p.name: (p.value - truth[p.name]) / p.std_dev for p in rows},
    )  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What an identifier did in one case. Times are in s since the change, inf for never.

    Attributes:
        model, case, motion, seed: which one.
        said: when it was said: not `converged` (unless the joint rests), a parameter is named as changed, or all that
            was known is forgotten; for the fault of a sensor also when the checks of residuals find something.
        right: from when on every estimate is `converged` and all estimated parameters are within 4 sigma of the truth.
        wrong_s: how long altogether an estimate was `converged` and not right.
        largest, worst: largest error over sigma of a `converged` estimate after the change, and its parameter.
        early: whether a change was named before there was one.
        raised: the error that ended the identifier; empty if there was none.
        cpu_s: processor time of the estimates.
    """

    model: str
    case: str
    motion: str
    seed: int
    said: float
    right: float
    wrong_s: float
    largest: float
    worst: str
    early: bool
    raised: str
    cpu_s: float


def outcome(joint: Joint, case_name: str, motion: str, seed: int, watched: Watched, faulty: bool) -> Outcome:
    """Watch a record and sum up what was said."""
    begun = time.process_time()
    hops, raised, since = [], "", watched.since
    try:
        for hop in watch(joint, watched):
            hops.append(hop)
    except Exception as error:  # what it raises is a result
        raised = f"{type(error).__name__}: {error}"
    after = [h for h in hops if h.end > since and not h.rests]
    known = {t for h in hops if h.end <= since for t in h.named}
    said = [h.end for h in after if _says(h, since, faulty)]
    bad = [not h.converged or h.largest > FAR for h in after]
    last = max((k for k, b in enumerate(bad) if b), default=-1)
    right = 0.0 if last < 0 else after[last + 1].end - since if last + 1 < len(after) else np.inf
    right = np.inf if raised else right
    lengths = np.diff([since, *(h.end for h in after)])
    wrong = sum(t for t, h in zip(lengths.tolist(), after, strict=True) if h.converged and h.largest > FAR)
    worst = max(after, key=lambda h: h.largest, default=None)
    return Outcome(
        joint.model.name, case_name, motion, seed, said[0] - since if said else np.inf, right, wrong,
        worst.largest if worst else 0.0, worst.worst if worst else "", bool(known), raised,
        time.process_time() - begun,
    )  # fmt: skip


def _says(hop: Hop, since: float, faulty: bool) -> bool:
    """Whether an estimate says that something is not as it was."""
    named = any(t > since - SINCE_S for t in hop.named)
    return not hop.converged or named or hop.forgot or (faulty and any(hop.found))
